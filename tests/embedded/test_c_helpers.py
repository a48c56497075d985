"""The functions of the C text against Python's whole numbers."""

import math
import random
import subprocess

import pytest

from cnnum.embedded.c.text import HELPERS
from tests.embedded.conftest import STRICT

NEEDED = ("limit64", "zeros", "scaled_root", "whole_root", "root64", "quotient64", "digit",
          "quotient_by_32", "limited31")  # fmt: skip
MAIN = """
int main(void)
{
    long long a, b;
    while (scanf("%lld %lld", &a, &b) == 2) {
        printf("%lld %lld %lld %lld\\n", (long long)root64(a), (long long)quotient64(a, b),
            (long long)quotient_by_32(a, (int32_t)b), (long long)limited31(a));
    }
    return 0;
}
"""


def quotient(a, b):
    """To the nearest, halves away from 0."""
    whole = (abs(a) + abs(b) // 2) // abs(b) if b else 0
    return whole if (a < 0) == (b < 0) else -whole


def pairs():
    """Numbers of every length and sign, squares and multiples and their neighbours, and ends."""
    draw = random.Random(0)
    for _ in range(5_000):
        b = draw.choice((-1, 1)) * draw.getrandbits(draw.randint(1, 31))
        a = draw.choice((-1, 1)) * draw.getrandbits(draw.randint(1, 62))
        root = draw.getrandbits(draw.randint(1, 31))
        multiple = b * draw.getrandbits(draw.randint(1, 31))
        half = multiple + b // 2
        for near in (-1, 0, 1):
            yield from (
                (a + near, b),
                (root * root + near, b),
                (multiple + near, b),
                (half + near, b),
            )
    for a in (0, 1, 2**30 - 1, 2**30, 2**31 - 1, 2**31, 2**32 - 1, 2**32, 2**62, 2**62 - 1):
        for b in (0, 1, 2, 2**15, 2**16, 2**16 - 1, 2**16 + 1, 2**30, 2**31 - 1):
            yield from ((a, b), (-a, b), (a, -b), (-a, -b))


@pytest.mark.parametrize("core", [(), ("-D__OPENCL_VERSION__=120",)], ids=["bits", "loop"])
def test_roots_quotients_and_limits_are_exact(core, compiler, tmp_path):
    """`core` decides how zeros before the first bit are counted."""
    text = ["#include <stdint.h>", "#include <stdio.h>", "#define CNNUM_PAIRS 0"]
    (tmp_path / "main.c").write_text("\n".join([*text, *(HELPERS[name] for name in NEEDED), MAIN]))
    command = [compiler, *STRICT, *core, "-O1", "-fsanitize=undefined", "-fno-sanitize-recover"]
    subprocess.run([*command, "-o", "main", "main.c"], cwd=tmp_path, check=True)
    given = list(pairs())
    said = subprocess.run(
        ["./main"],
        cwd=tmp_path,
        input="".join(f"{a} {b}\n" for a, b in given),
        capture_output=True,
        text=True,
        check=True,
    )
    for (a, b), line in zip(given, said.stdout.splitlines(), strict=True):
        whole = quotient(a, b)
        wanted = [math.isqrt(max(a, 0)), whole, whole, max(-(2**30), min(2**30 - 1, a))]
        assert [int(word) for word in line.split()] == wanted, (a, b)
