"""A program's C on a microcontroller: built by Zig's compiler, run and counted by Unicorn.

Counts are instructions that were executed, not cycles. Both tools are extras for measuring and
testing (Unicorn is under the GPL). Nothing of them is part of the package.
"""

import subprocess
import sys
import tempfile
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from importlib import import_module
from importlib.util import find_spec
from math import inf
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cnnum.arrays import Floats
from cnnum.embedded.c.files import identifier
from cnnum.embedded.c.text import packed, record_type
from cnnum.embedded.emulator import Numbers
from cnnum.embedded.making import Made
from cnnum.errors import DeviceError, missing_extra, name_error
from cnnum.lab.embedded.cycles import Interval, cycles_of
from cnnum.safety.files import write_whole

CORES = {"m0": "cortex_m0", "m4": "cortex_m4", "m7": "cortex_m7"}
"""By the name that users give: as Zig calls them."""

STACK, STACK_BYTES = 0x30000000, 0x10000
RETURN = 0x08000000
PAGE = 0x1000
LONGEST = 100_000_000
"""Instructions after which a frame is given up."""

FLAGS = ("-O2", "-std=c99", "-ffp-contract=off", "-ffunction-sections", "-fdata-sections", "-g0")
LINKED = ("-Wl,-e,board_main", "-Wl,--gc-sections", "-static")
TOOLS = ("ziglang", "unicorn", "elftools")


def missing_tools() -> tuple[str, ...]:
    """Return which of the tools are not installed."""
    return tuple(name for name in TOOLS if find_spec(name) is None)


@dataclass(frozen=True, slots=True)
class Counted:
    """The cost of frames.

    Attributes
    ----------
    core : str
    instructions : tuple of int
        Instructions per frame.
    flash_bytes, ram_bytes, stack_bytes : int
        Code and tables; memory, frame, answers and stack; the deepest stack alone.
    wrong : int
        Numbers of answers that differ from the emulator's.
    cycles : (least, most)
        Cycles of the longest frame, by `cnnum.lab.embedded.cycles`.
    """

    core: str
    instructions: tuple[int, ...]
    flash_bytes: int
    ram_bytes: int
    stack_bytes: int
    wrong: int
    cycles: Interval = (0.0, inf)

    @property
    def worst(self) -> int:
        """Instructions of the longest frame."""
        return max(self.instructions)

    def frames_per_second(self, clock: float) -> float:
        """Return the highest frame rate at a clock, in Hz, of one instruction per cycle."""
        return clock / self.worst


@dataclass(eq=False)
class Board:
    """An image for one core.

    Attributes
    ----------
    made : Made
    core : str
    elf : bytes
    """

    made: Made
    core: str
    elf: bytes

    @classmethod
    def built(cls, made: Made, frames: Floats, core: str, flags: Sequence[str] = ()) -> "Board":
        """Return the image of a program; flags are further ones of the compiler.

        Raises
        ------
        MissingExtraError
            If a tool is not installed.
        UnknownNameError
            If there is no such core.
        DeviceError
            If the compiler refuses the program.
        """
        if core not in CORES:
            raise name_error("core", core, CORES)
        if tools := missing_tools():
            raise missing_extra("counting instructions", ", ".join(tools), "embedded")
        name = identifier(made.program.name)
        with tempfile.TemporaryDirectory() as folder:
            place = Path(folder)
            made.export(frames).write(place)
            write_whole(place / "board.c", board_text(name))
            command = [
                *(sys.executable, "-P", "-m", "ziglang", "cc"),
                *("-target", "thumb-freestanding-eabi"),
                f"-mcpu={CORES[core]}",
                *FLAGS,
                *flags,
                *LINKED,
                "-o",
                "board.elf",
                "board.c",
                f"{name}.c",
            ]
            done = subprocess.run(command, cwd=place, capture_output=True, text=True, check=False)
            if done.returncode:
                raise DeviceError(
                    f"The compiler for {core} refused the program: {done.stderr:.400}"
                )
            return cls(made, core, (place / "board.elf").read_bytes())

    @cached_property
    def sections(self) -> Any:
        """The file as pyelftools reads it."""
        elf: Any = import_module("elftools.elf.elffile")
        import io

        return elf.ELFFile(io.BytesIO(self.elf))

    @cached_property
    def symbols(self) -> dict[str, int]:
        """Addresses by name."""
        table = self.sections.get_section_by_name(".symtab")
        return {symbol.name: int(symbol["st_value"]) for symbol in table.iter_symbols()}

    def _bytes_of(self, *, written: bool) -> int:
        """Return the bytes of sections that are loaded: the writable ones, or the others."""
        total = 0
        for section in self.sections.iter_sections():
            flags, name = section["sh_flags"], section.name
            # SHF_ALLOC, SHF_WRITE; tables to unwind a stack are of no use here
            if flags & 2 and bool(flags & 1) == written and not name.startswith(".ARM.ex"):
                total += int(section["sh_size"])
        return total

    def run(self, frames: Floats, wait_states: int = 0) -> Counted:
        """Run frames of one stream and compare every answer with the emulator's.

        Parameters
        ----------
        frames : (frames, rows, cols, channels) float
        wait_states : int
            Of the flash, for the upper bound of cycles.
        """
        from cnnum.embedded.emulator import cleared

        program, machine = self.made.program, Machine(self)
        inputs, outputs = program.of_kind("input"), program.of_kind("output")
        layout, state = record_type(outputs), cleared(program, 1)
        machine.call("board_reset")
        counts, cycles, wrong = list[int](), list[Interval](), 0
        for number, frame in enumerate(frames):
            given = self.made.inputs(frame[np.newaxis])
            machine.write("board_input", packed(inputs, given, 1).tobytes())
            counts.append(machine.call("board_step"))
            cycles.append(cycles_of(self.core, machine.executed, machine.fetch, wait_states))
            answer: NDArray[Any] = np.frombuffer(
                machine.read("board_output", layout.itemsize), layout
            )
            wanted = self.made.emulator().run(given, state, first=number == 0)
            wrong += sum(
                _differing(answer[output.name][0], wanted[output.name]) for output in outputs
            )
        stack = machine.deepest
        ram = self._bytes_of(written=True) + stack
        longest = max(least for least, _ in cycles), max(most for _, most in cycles)
        flash = self._bytes_of(written=False)
        return Counted(self.core, tuple(counts), flash, ram, stack, wrong, longest)


def _differing(answer: NDArray[Any], wanted: Numbers) -> int:
    flat = np.broadcast_to(wanted.reshape(-1), answer.shape)
    if answer.dtype.kind == "f":
        return int((np.abs(answer - flat) > 1e-3 * (np.abs(flat) + 1.0)).sum())
    return int((answer != flat).sum())


class Machine:
    """An emulated core with an image in its memory."""

    def __init__(self, board: Board) -> None:
        self._uc: Any = import_module("unicorn")
        self._arm: Any = import_module("unicorn.arm_const")
        self._board = board
        mode = self._uc.UC_MODE_THUMB | self._uc.UC_MODE_MCLASS
        self._machine: Any = self._uc.Uc(self._uc.UC_ARCH_ARM, mode)
        model = f"UC_CPU_ARM_CORTEX_{board.core.upper()}"
        self._machine.ctl_set_cpu_model(getattr(self._arm, model))
        self._machine.mem_map(STACK, STACK_BYTES)
        self._machine.mem_map(RETURN, PAGE)
        self._load()
        self.deepest = 0
        self._counts = True
        self.executed = Counter[int]()

    def _load(self) -> None:
        pages = set[int]()
        sections = board_sections(self._board)
        for at, data in sections:
            for page in range(at // PAGE, (at + len(data)) // PAGE + 1):
                if page not in pages:
                    self._machine.mem_map(page * PAGE, PAGE)
                    pages.add(page)
            self._machine.mem_write(at, data)

    def write(self, symbol: str, data: bytes) -> None:
        """Write bytes where a symbol is."""
        self._machine.mem_write(self._board.symbols[symbol], data)

    def read(self, symbol: str, count: int) -> bytes:
        """Return bytes from where a symbol is."""
        return bytes(self._machine.mem_read(self._board.symbols[symbol], count))

    def fetch(self, address: int) -> int:
        """Return the half-word at an address."""
        return int.from_bytes(self._machine.mem_read(address, 2), "little")

    def call(self, function: str, *, counts: bool = True) -> int:
        """Call a function; return how many instructions it took, and keep which in `executed`.

        Without `counts`, it is a hundred times as fast and returns 0.
        """
        executed = self.executed = Counter[int]()
        low, top = STACK + STACK_BYTES, STACK + STACK_BYTES - 16
        stack_pointer = self._arm.UC_ARM_REG_SP

        def block(machine: Any, address: int, size: int, _: object) -> None:
            nonlocal low
            low = min(low, machine.reg_read(stack_pointer))

        def code(_: Any, address: int, size: int, __: object) -> None:
            executed[address] += 1

        hooks = list[Any]()
        if counts != self._counts:  # a block that was translated without hooks calls none
            self._counts = counts
            self._machine.ctl_flush_tb()
        if counts:
            hooks.append(self._machine.hook_add(self._uc.UC_HOOK_CODE, code))
            hooks.append(self._machine.hook_add(self._uc.UC_HOOK_BLOCK, block))
        self._machine.reg_write(stack_pointer, top)
        self._machine.reg_write(self._arm.UC_ARM_REG_LR, RETURN | 1)
        try:
            self._machine.emu_start(
                self._board.symbols[function] | 1, RETURN, count=LONGEST if counts else 0
            )
        except self._uc.UcError as error:
            raise DeviceError(f"The program stopped on {self._board.core}: {error}.") from error
        finally:
            for hook in hooks:
                self._machine.hook_del(hook)
        self.deepest = max(self.deepest, top - low)
        return executed.total()


def board_sections(board: Board) -> list[tuple[int, bytes]]:
    """Return where each loaded section lies, and its bytes."""
    result = list[tuple[int, bytes]]()
    for section in board.sections.iter_sections():
        if section["sh_flags"] & 2 and section["sh_size"]:
            empty = section["sh_type"] == "SHT_NOBITS"
            data = bytes(section["sh_size"]) if empty else bytes(section.data())
            result.append((int(section["sh_addr"]), data))
    return result


def board_text(name: str) -> str:
    """Return the C that calls a program: a frame, its answers and the memory at known names."""
    return "\n".join(
        [
            f'#include "{name}.h"',
            f"{name}_memory board_memory;",
            f"{name}_input board_input;",
            f"{name}_output board_output;",
            "__attribute__((noinline)) void board_reset(void);",
            "__attribute__((noinline)) void board_step(void);",
            "void board_main(void);",
            "/* keeps both */",
            "void board_main(void) { board_reset(); board_step(); }",
            f"void board_reset(void) {{ {name}_reset(&board_memory); }}",
            f"void board_step(void) {{ {name}_step(&board_memory, &board_input, &board_output); }}",
            "",
        ]
    )
