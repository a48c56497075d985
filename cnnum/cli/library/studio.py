"""`cnnum studio`: a template at work in a browser, to change and to keep."""

import secrets

import click

from cnnum.cli.library.templates_convert import is_place
from cnnum.cli.options import completed, json_option, page_options
from cnnum.cli.output import COMPILING, Output, busy
from cnnum.cli.signals import stoppable


@click.command("studio")
@click.argument("template", default="EDGE", shell_complete=completed("template", files=True))
@page_options(8766)
@json_option
def command(template: str, host: str, port: int, token: str, as_json: bool) -> int:
    """Change TEMPLATE (of the library, or a file) in a browser and see it move, until Ctrl-C.

    The page also finds weights for a rule, counts flips under mismatch, compares two templates, and
    saves TOML. Only this machine can reach it; with --host others can, and need a token.
    """
    from cnnum.live.server import Place, is_loopback, run_door

    if not is_loopback(host) and not token:
        token = secrets.token_urlsafe(12)
    where = Place(host, port, token)
    with busy(COMPILING, as_json=as_json):
        from cnnum.live.studio import Studio
        from cnnum.templating.files import load_entry
        from cnnum.templating.library import get_entry

        door = Studio(where, load_entry(template) if is_place(template) else get_entry(template))
    output = Output(as_json)

    def ready(address: str) -> None:
        output.record(
            {"kind": "studio", "address": address}, f"Open {address} in a browser; Ctrl-C ends it."
        )

    try:
        with stoppable():
            run_door(door, "the studio", ready)
    except KeyboardInterrupt:
        return 130
    return 0
