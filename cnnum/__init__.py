"""cnnum: an emulator of the cellular-wave computer that processes tactile scenes.

The public names stand in `__init__.pyi`, once. Each is imported when it is first used, so that
`import cnnum` is quick and needs NumPy alone.
"""

# pyright: reportUnknownVariableType=false, reportUnknownMemberType=false, reportMissingTypeStubs=false
# (lazy_loader has no types; the stub beside this file has those of the public names)
from pathlib import Path

import lazy_loader

_CHECKOUT = Path(__file__).resolve().parents[1]
if not Path(__file__).with_name("drivers").is_dir() and (_CHECKOUT / "drivers/driver.py").exists():
    # a checkout without symbolic links, or an unpacked source archive: `cnnum.drivers` and
    # `cnnum.templates` stand next to this folder
    __path__.append(str(_CHECKOUT))

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
