"""Random programs, and what they give: one description, two interpreters that share nothing.

A description is a list of steps. One interpreter makes the program of it that a user would write;
engines run it, and a C compiler. The other one is plain NumPy in double precision: every number has
a bound `off` by which a precision may round it, which is 0 where the documented formats hold it
exactly. Then an answer must be equal to the bit. Where a comparison of rounded numbers may fall
either way, all that follows from it is unknown (infinite).

    python -m tests.fuzz.random_programs --programs 100 --seed 7

tries a shard, and ends with the numbers of programs tried and wrong. A wrong one is named by its
seed: `--programs 1 --seed SEED` tries it on frames of its own. Those of its shard are drawn by the
first of the programs that engines ran `--together`.
"""

import argparse
import collections
import math
import re
import subprocess
import sys
import tempfile
import time
from dataclasses import replace
from pathlib import Path

import numpy as np

import cnnum
from tests.fuzz.program_oracle import EXPORTED, FLOAT32, FLOAT64, WHOLE, Oracle
from tests.fuzz.program_writer import CHANNELS, FRAMES, SHAPE, STREAMS, Writer, program_of


class Drawn:
    """A program of a seed, and what it gives in every precision."""

    def __init__(self, seed, steps, outputs, frames) -> None:
        self.seed, self.steps, self.outputs = seed, steps, outputs
        measured = Oracle(steps, outputs)
        measured.run(frames)
        seen = measured.later, measured.early
        self.wanted = {
            one: Oracle(steps, outputs, one, seen).run(frames)
            for one in (FLOAT64, FLOAT32, EXPORTED, *WHOLE)
        }


class Shard:
    """Tries programs on all engines, in all precisions, and as compiled C."""

    def __init__(self, *, compiler=None, engines=None) -> None:
        self.compiler = compiler
        self.engines = ("reference", "opencl", "numba") if engines is None else engines
        self.tried, self.refused, self.wrong = 0, collections.Counter(), []
        self.compared = self.known = self.exact = 0
        self.pending = []
        self.made = {}

    def engine(self, name, precision):
        key = name, precision
        if key not in self.made:
            self.made[key] = cnnum.Engine(name, precision=precision)
        return self.made[key]

    def one(self, seed):
        """Try the program of a seed."""
        self.some([seed])

    def some(self, seeds):
        """Try the programs of seeds, on the frames of the first one.

        Engines run them as one program: most of the time of a small one is that of an OpenCL
        compiler at its start. A fault of one program in another shows as a wrong number.
        """
        drawn, frames = [], None
        for seed in seeds:
            writer = Writer(seed)
            steps, _, outputs = writer.program()
            if frames is None:
                frames = writer.eighths(writer.pick([1, 2]), (FRAMES, STREAMS, *SHAPE, 2))
            drawn.append(Drawn(seed, steps, outputs, frames))
        self.tried += len(drawn)
        for one in (FLOAT64, FLOAT32, *WHOLE):
            for engine in self.engines:
                self.on_engine(drawn, frames, engine, one)
        for each in drawn if self.compiler else ():
            for one in (EXPORTED, *WHOLE):
                self.to_c(each, frames, one)

    def on_engine(self, drawn, frames, engine, rounding):
        precision = rounding.name
        alone = {"numba": bool(rounding.word), "reference": precision == "float32"}
        if alone.get(engine):
            return
        options = {"like": frames} if rounding.word else {}
        begins = [f"{each.seed} " if len(drawn) > 1 else "" for each in drawn]
        described = [
            (each.steps, each.outputs, begin) for each, begin in zip(drawn, begins, strict=True)
        ]
        program = program_of(described, f"p{drawn[0].seed}")
        try:
            plan = self.engine(engine, precision).compile(
                program, SHAPE, channels=CHANNELS, **options
            )
            stream = plan.stream((STREAMS,))
            found = [stream.push(frame) for frame in frames]
        except cnnum.CnnumError as error:
            if len(drawn) > 1:
                for each in drawn:
                    self.on_engine([each], frames, engine, rounding)
            else:
                self.refuse(
                    drawn[0].seed, f"{engine} {precision}", error, drawn[0].wanted[rounding]
                )
            return
        for each, begin in zip(drawn, begins, strict=True):
            mine = [{name: one[f"{begin}{name}"] for name in each.outputs} for one in found]
            self.compare(each.seed, f"{engine} {precision}", mine, each.wanted[rounding])

    def refuse(self, seed, where, error, answers):
        # what the documentation refuses: more than 64 bits on the way, and numbers beyond a float's
        large = re.search(r"Output '(.*?)'.* is not finite", str(error))
        expected = "64 bits" in str(error) or (
            large and any(np.isinf(one[large[1]].off).any() for one in answers)
        )
        self.refused[str(error)[:60]] += 1
        if not expected:
            self.wrong.append((seed, where, f"{type(error).__name__}: {error}"))

    def compare(self, seed, where, found, answers):
        for number, (got, wanted) in enumerate(zip(found, answers, strict=True)):
            for name, one in wanted.items():
                value = np.asarray(got[name], dtype=np.float64)
                v = np.broadcast_to(
                    one.v, (*value.shape, 1, 1)[:3] if value.ndim == 1 else value.shape
                )
                value = value.reshape(v.shape)
                off = np.broadcast_to(one.off, v.shape)
                known = np.isfinite(off)
                self.compared += v.size
                self.known += int(known.sum())
                self.exact += int((off == 0.0).sum())
                far = known & ~(np.abs(value - v) <= off * (1.0 + 1e-9))
                if far.any():
                    at = tuple(np.argwhere(far)[0])
                    self.wrong.append(
                        (seed, where, f"frame {number}, '{name}' {at}: {value[at]} for {v[at]} "
                         f"± {off[at]:.3g}")
                    )  # fmt: skip
                    return

    # compiled C

    def to_c(self, drawn, frames, rounding):
        from cnnum.embedded.formats import precision_named
        from cnnum.embedded.making import make
        from cnnum.graph.schedule import schedule

        seed, answers = drawn.seed, drawn.wanted[rounding]
        program = program_of([(drawn.steps, drawn.outputs, "")], f"p{seed}")
        name = f"{program.name}_{rounding.name.replace('.', '_')}"
        planned = schedule(program.trace(SHAPE, CHANNELS), CHANNELS, None)
        try:
            made = make(name, planned, precision_named(rounding.name), frames)
            # working arrays of every second program share memory
            made = replace(made, shares=seed % 2 == 1)
            # all of them would take most of the time
            vector = frames if seed % 7 == 0 else frames[:2, :1]
            files = made.export(vector).files
        except cnnum.CnnumError as error:
            self.refuse(seed, f"C {rounding.name}", error, answers)
            return
        self.pending.append((seed, name, made, files, frames, rounding, answers))

    def on_cores(self, cores):
        """Run the programs that wait on emulated cores, for the bits of the emulator."""
        from cnnum.lab.embedded.cortex_m import Board

        for seed, name, made, _, frames, rounding, _ in self.pending:
            for core in cores if rounding.word else ():
                counted = Board.built(made, frames[:1, 0], core).run(frames[:, 0])
                self.compared += len(counted.instructions)
                if counted.wrong:
                    self.wrong.append((seed, f"{core} {name}", f"{counted.wrong} numbers"))

    def compile(self):
        """Compile the programs that wait, all in one image, and compare what they give."""
        from cnnum.embedded.c.text import packed, record_type

        if not self.pending:
            return
        with tempfile.TemporaryDirectory() as folder:
            place, given = Path(folder), b""
            for _, name, made, files, frames, _, _ in self.pending:
                (place / f"{name}.h").write_text(files[f"{name}.h"])
                vector = files["vector.c"].replace(
                    "int main(void)", f"int vector_{name}(void);\nint vector_{name}(void)"
                )
                # in one unit: most of the time is that of the compiler's start
                (place / f"{name}.c").write_text(files[f"{name}.c"] + vector)
                inputs = made.program.of_kind("input")
                for lane in range(STREAMS):
                    for frame in frames:
                        one = made.inputs(frame[lane : lane + 1])
                        given += packed(inputs, one, 1).tobytes()
            (place / "all.c").write_text(drivers([one[1] for one in self.pending]))
            sources = sorted(path.name for path in place.glob("*.c"))
            command = [
                self.compiler, "-std=c99", "-Wall", "-Wextra", "-Wconversion", "-Werror", "-O0",
                "-ffp-contract=off", "-fsanitize=undefined,address", "-fno-sanitize-recover=all",
                "-o", "all", *sources, "-lm",
            ]  # fmt: skip
            done = subprocess.run(command, cwd=place, capture_output=True, text=True, check=False)
            if done.returncode:
                lines = [line for line in done.stderr.splitlines() if "error" in line]
                for seed, name, *_ in self.pending:
                    mine = [line for line in lines if name in line]
                    if mine or not lines:
                        self.wrong.append((seed, f"gcc {name}", (mine or [done.stderr])[0][:300]))
                self.pending = []
                return
            done = subprocess.run([place / "all"], input=given, capture_output=True, check=False)
            if done.returncode:
                seeds = [one[0] for one in self.pending]
                self.wrong.append((seeds[0], "C", done.stderr.decode(errors="replace")[:600]))
                self.pending = []
                return
            self.read(done.stdout, record_type)
        self.pending = []

    def read(self, text, record_type):
        from cnnum.embedded.c.text import unpacked

        at = 0
        for seed, name, made, _, frames, rounding, answers in self.pending:
            outputs = made.program.of_kind("output")
            layout = record_type(outputs)
            size = layout.itemsize * FRAMES * STREAMS
            records = np.frombuffer(text[at : at + size], layout).reshape(STREAMS, FRAMES)
            at += size
            passed = text[at : at + 1]
            at += 1
            if passed != b"1":
                self.wrong.append((seed, f"C {rounding.name}", "its own vector fails"))
            found = [made.outputs(unpacked(outputs, records[:, n])) for n in range(FRAMES)]
            self.compare(seed, f"C {rounding.name}", found, answers)
            if rounding.word:
                emulated = made.run(frames)
                for key, values in emulated.items():
                    got = np.stack([one[key] for one in found])
                    if not np.array_equal(got, values):
                        self.wrong.append((seed, f"C {name}", f"'{key}' is not the emulator's"))
                        break
        assert at == len(text)


def drivers(names):
    """Return a main program that runs all, each in STREAMS streams, and its vector."""
    lines = [*(f'#include "{name}.h"' for name in names), "#include <stdio.h>", ""]
    body = []
    for name in names:
        lines += [
            f"int vector_{name}(void);",
            f"static int run_{name}(void)",
            "{",
            f"    static {name}_memory memory; static {name}_input input;",
            f"    static {name}_output output;",
            f"    for (int s = 0; s < {STREAMS}; ++s) {{",
            f"        {name}_reset(&memory);",
            f"        for (int n = 0; n < {FRAMES}; ++n) {{",
            "            if (fread(&input, sizeof input, 1, stdin) != 1) { return 1; }",
            f"            {name}_step(&memory, &input, &output);",
            "            if (fwrite(&output, sizeof output, 1, stdout) != 1) { return 1; }",
            "        }",
            "    }",
            f"    return putchar(vector_{name}() == 0 ? '1' : '0') == EOF;",
            "}",
        ]
        body.append(f"    if (run_{name}()) {{ return 2; }}")
    return "\n".join([*lines, "int main(void)", "{", *body, "    return 0;", "}", ""])


def main() -> int:
    parser = argparse.ArgumentParser()
    parser.add_argument("--programs", type=int, default=100)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--together", type=int, default=8, help="programs that engines run as one")
    parser.add_argument("--seconds", type=float, default=math.inf)
    parser.add_argument("--engines", default="reference,opencl,numba")
    parser.add_argument("--no-c", action="store_true")
    asked = parser.parse_args()
    compiler = None if asked.no_c else "cc"
    shard, began = Shard(compiler=compiler, engines=asked.engines.split(",")), time.monotonic()
    last = asked.seed + asked.programs
    for first in range(asked.seed, last, asked.together):
        seed = min(first + asked.together, last) - 1
        shard.some(range(first, seed + 1))
        if len(shard.pending) >= 40:
            shard.compile()
        if time.monotonic() - began > asked.seconds:
            break
    shard.compile()
    for row in shard.wrong[:40]:
        print(*row)
    for words, count in shard.refused.most_common(8):
        print(f"refused {count}: {words}")
    wrong = len({row[0] for row in shard.wrong})
    bounded, seconds = shard.known - shard.exact, time.monotonic() - began
    print(
        f"tried {shard.tried}, wrong {wrong}, seeds {asked.seed} to {seed}; numbers compared "
        f"{shard.compared}, of them exact {shard.exact}, within a bound {bounded}; {seconds:.0f} s"
    )
    return int(wrong > 0)


if __name__ == "__main__":
    sys.exit(main())
