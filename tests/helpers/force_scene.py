"""A scene of contacts in a file of one's own, whose counts grow with the force."""


def force_scene(path, needs='"contact"'):
    """The text of a scene file."""
    return f"""
needs = [{needs}]
[array]
driver = "file"
path = "{path}"
[program]
name = "contact"
[program.parameters]
push = 1.0
reads = "force"
"""
