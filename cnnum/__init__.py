"""cnnum: an emulator of the cellular-wave computer that processes tactile scenes.

The public names stand in `__init__.pyi`, once. Each is imported when it is first used, so that
`import cnnum` is quick and needs NumPy alone.
"""

# pyright: reportUnknownVariableType=false, reportUnknownMemberType=false, reportMissingTypeStubs=false
# (lazy_loader has no types; the stub beside this file has those of the public names)
import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
