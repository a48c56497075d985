"""The cost of a program on a microcontroller by precision, and the loss of each."""

from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass

from cnnum.arrays import Shape
from cnnum.errors import CnnumError, NotSupportedError
from cnnum.lab.embedded.cortex_m import Board
from cnnum.lab.embedded.gnu_arm import gnu_counted, missing_gnu_tools
from cnnum.lab.embedded.scores import NO_EVENTS, events, loss
from cnnum.lab.embedded.streams import made, vector_frames

PRECISIONS = ("q15", "q7", "q23", "float32")
USUAL = ("slip", "twist")
SHAPES: tuple[Shape, ...] = ((4, 4), (8, 8), (16, 16))
COUNTED = 4
"""Frames that are counted: in the middle of a slip, where loops are longest."""

SCENES = 2
"""Of each kind, in which reports are scored."""

Case = tuple[str, Shape, str, str, str]
"""Program, shape, precision, method, core."""


@dataclass(frozen=True, slots=True)
class CostRow:
    """One program in one configuration.

    Attributes
    ----------
    case : str
        The program.
    shape : (rows, cols)
    precision, method, core : str
    instructions : int
        Of the longest frame: counted, not timed, and no cycles.
    ram_bytes, flash_bytes : int
        From the ELF file; RAM with frame, answers and the deepest stack.
    error : float
        Against the reference engine, of the output with the largest.
    output : str
        Its name.
    flags_differ : float
        Share of the flags up here or on the reference engine that are not up on both.
    slip_recall, twist_recall, false_reports : float
        Of reports; false ones in ten minutes.
    reports_differ : float
        Share of the frames with a report here or in float32 that lack it in one of them.
    frames_per_s : float
        At most, at the clock, if an instruction took a cycle.
    clock_hz : float
    stack_bytes : int
        The deepest stack.
    wrong : int
        Numbers that differ from the emulator's: 0.
    gnu_instructions, gnu_flash_bytes : int or None
        The same by GCC for Arm and QEMU, where they are installed; flash of the program alone.
    """

    case: str
    shape: Shape
    precision: str
    method: str
    core: str
    instructions: int
    ram_bytes: int
    flash_bytes: int
    error: float
    output: str
    flags_differ: float
    slip_recall: float
    twist_recall: float
    false_reports: float
    reports_differ: float
    frames_per_s: float
    clock_hz: float
    stack_bytes: int
    wrong: int
    gnu_instructions: int | None = None
    gnu_flash_bytes: int | None = None


def cases(
    programs: Sequence[str],
    shapes: Sequence[Shape],
    precisions: Sequence[str],
    methods: Sequence[str],
    cores: Sequence[str],
) -> list[Case]:
    """Return all configurations."""
    return [
        (program, shape, precision, method, core)
        for program in programs
        for shape in shapes
        for precision in precisions
        for method in methods
        for core in cores
    ]


def measure_costs(some: Sequence[Case], clock: float, scenes: int) -> Iterator[CostRow | str]:
    """Yield a row a configuration, or a sentence of one that is left out.

    Parameters
    ----------
    some : sequence of Case
    clock : float
        Hz.
    scenes : int
        Of each kind, in which reports are scored; 0 scores none.
    """
    known: dict[tuple[str, Shape, str, str], tuple[object, ...]] = {}
    for program, shape, precision, method, core in some:
        key = (program, shape, precision, method)
        try:
            if key not in known:
                known.clear()
                found = made(program, shape, precision, method)
                scored = events(found, shape, scenes) if scenes else NO_EVENTS
                known[key] = (found, loss(found, shape), scored)
            yield _row(key, core, clock, known[key])
        except NotSupportedError as error:
            yield f"{program} on {shape[0]}×{shape[1]} in {precision} by {method}: {error}"
        except CnnumError as error:
            if not isinstance(error, ValueError):
                raise
            yield f"{program} on {shape[0]}×{shape[1]}: {error}"


def _row(
    key: tuple[str, Shape, str, str], core: str, clock: float, known: tuple[object, ...]
) -> CostRow:
    from cnnum.embedded.making import Made
    from cnnum.lab.embedded.scores import Events, Loss

    found, lost, scored = known
    assert isinstance(found, Made)
    assert isinstance(lost, Loss)
    assert isinstance(scored, Events)
    program, shape, precision, method = key
    frames = vector_frames(shape, COUNTED)
    counted = Board.built(found, frames[:1], core).run(frames)
    gnu = None
    if found.precision.integer and not missing_gnu_tools():
        gnu = gnu_counted(found, frames, core)
    return CostRow(
        case=program,
        shape=shape,
        precision=precision,
        method=method,
        core=core,
        instructions=counted.worst,
        ram_bytes=counted.ram_bytes,
        flash_bytes=counted.flash_bytes,
        **asdict(lost),
        **asdict(scored),
        frames_per_s=counted.frames_per_second(clock),
        clock_hz=clock,
        stack_bytes=counted.stack_bytes,
        wrong=counted.wrong + (0 if gnu is None else gnu.wrong),
        gnu_instructions=None if gnu is None else max(gnu.instructions),
        gnu_flash_bytes=None if gnu is None else gnu.flash_bytes,
    )
