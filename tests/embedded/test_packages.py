"""An export as a package of five build systems; CMake and GCC build it.

Arduino, PlatformIO, Zephyr and ESP-IDF themselves are not here: stand-ins of their few functions
show that the files name what is there, and that it compiles, and no more.
"""

import json
import shutil
import subprocess
import sys
from base64 import b64encode
from importlib.util import find_spec

import numpy as np
import pytest
from click.testing import CliRunner

import cnnum
from cnnum.cli import main
from cnnum.embedded.c.packages import PACKAGES
from cnnum.embedded.c.text import packed
from cnnum.embedded.emulator import Emulator, cleared
from cnnum.errors import UnknownNameError

needs_cc = pytest.mark.skipif(
    shutil.which("cc") is None or shutil.which("make") is None, reason="no C compiler"
)
needs_cmake = pytest.mark.skipif(shutil.which("cmake") is None, reason="no CMake")


def function(frame):
    past = frame.memory("past")
    past.store(0.5 * past.value + frame.normal)
    return {"most": past.value.max(), "root": cnnum.sqrt(frame.normal)}


RESERVED = cnnum.Program(function, "test")
"""Its name is a reserved word of CMake."""


@pytest.fixture(scope="module")
def exported():
    frames = np.random.default_rng(0).uniform(0.0, 4.0, (20, 2, 3, 1))
    return {
        precision: cnnum.export(RESERVED, like=frames, precision=precision)
        for precision in ("q15", "float32")
    }


def run(*command, cwd):
    done = subprocess.run(command, cwd=cwd, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout


STAND_INS = """cmake_minimum_required(VERSION 3.13)
project(all_of_them LANGUAGES C)
enable_testing()
function(idf_component_register)
    cmake_parse_arguments(ARG "" "" "SRCS;INCLUDE_DIRS" ${ARGN})
    add_library(esp STATIC ${ARG_SRCS})
    target_include_directories(esp PUBLIC ${ARG_INCLUDE_DIRS})
endfunction()
function(zephyr_library_named name)
    add_library(zephyr STATIC "")
endfunction()
function(zephyr_library_sources)
    target_sources(zephyr PRIVATE ${ARGN})
endfunction()
function(zephyr_include_directories)
    target_include_directories(zephyr PUBLIC ${ARGN})
endfunction()
set(CONFIG_CNNUM_TEST y)
add_subdirectory(esp-idf)
add_subdirectory(zephyr/zephyr)
foreach(lib esp zephyr)
    add_executable(${lib}_vector esp-idf/vector.c)
    target_link_libraries(${lib}_vector ${lib} m)
    add_test(NAME ${lib} COMMAND ${lib}_vector)
endforeach()
add_subdirectory(cmake)
add_executable(cmake_vector cmake/vector.c)
target_link_libraries(cmake_vector cnnum_test::cnnum_test)
add_test(NAME cmake COMMAND cmake_vector)
"""

FOUND = """cmake_minimum_required(VERSION 3.13)
project(user LANGUAGES C)
find_package(cnnum_test REQUIRED)
add_executable(user ../cmake/vector.c)
target_link_libraries(user cnnum_test::cnnum_test)
"""


@needs_cc
@needs_cmake
@pytest.mark.one_in(2)
@pytest.mark.parametrize("precision", ["q15", "float32"])
def test_cmake_builds_installs_and_finds_it(exported, precision, tmp_path):
    for kind in ("cmake", "zephyr", "esp-idf"):
        exported[precision].packaged(kind).write(tmp_path / kind)
    (tmp_path / "CMakeLists.txt").write_text(STAND_INS)
    run("cmake", "-S", ".", "-B", "build", f"-DCMAKE_INSTALL_PREFIX={tmp_path}/root", cwd=tmp_path)
    run("cmake", "--build", "build", cwd=tmp_path)
    said = run("ctest", "--test-dir", "build", cwd=tmp_path)
    assert "100% tests passed, 0 tests failed out of 3" in said
    run("cmake", "--install", "build", cwd=tmp_path)
    (tmp_path / "user").mkdir()
    (tmp_path / "user" / "CMakeLists.txt").write_text(FOUND)
    root = f"-DCMAKE_PREFIX_PATH={tmp_path}/root"
    run("cmake", "-S", "user", "-B", "user/build", root, cwd=tmp_path)
    run("cmake", "--build", "user/build", cwd=tmp_path)
    run("user/build/user", cwd=tmp_path)


ARDUINO = """#include <cstdio>
struct Port {
    void begin(long) {}
    void println(const char *text) { std::puts(text); }
};
static Port Serial;
#include "self_test.ino"
int main() { setup(); loop(); }
"""


@needs_cc
@pytest.mark.skipif(shutil.which("c++") is None, reason="no C++ compiler")
def test_the_sketch_replays_the_vector(exported, tmp_path):
    """All C of 'src' and of the sketch's folder is compiled, as Arduino does."""
    exported["q15"].packaged("arduino").write(tmp_path)
    run("make", "check", cwd=tmp_path)
    assert not list(tmp_path.glob("test.*"))
    sketch = tmp_path / "examples" / "self_test"
    (sketch / "main.cpp").write_text(ARDUINO)
    sources = [*(tmp_path / "src").glob("*.c"), *sketch.glob("*.c")]
    run("cc", "-c", f"-I{tmp_path}/src", *sources, cwd=sketch)
    run("c++", f"-I{tmp_path}/src", "-o", "sketch", "main.cpp", "test.o", "vector.o", cwd=sketch)
    assert run("./sketch", cwd=sketch) == "The test vector passes.\n"
    assert "includes=test.h\n" in (tmp_path / "library.properties").read_text()
    loaded = cnnum.load_export(tmp_path)
    assert loaded.run(np.ones((2, 2, 3)))["most"].tolist() == [0.0, 1.0]


PAGE = """<body></body><script>
const code = Uint8Array.from(atob("@code"), c => c.charCodeAt(0));
const frames = Uint8Array.from(atob("@frames"), c => c.charCodeAt(0));
const module = new WebAssembly.Instance(new WebAssembly.Module(code)).exports;
const bytes = () => new Uint8Array(module.memory.buffer);
let said = "vector " + module.vector();
module.reset();
for (let at = 0; at < frames.length; at += @in) {
    bytes().set(frames.subarray(at, at + @in), module.input());
    module.step();
    said += " " + bytes().slice(module.output(), module.output() + @out).join();
}
if (typeof document === "undefined") console.log(said); else document.body.textContent = said;
</script>"""


@pytest.mark.skipif(find_spec("ziglang") is None, reason="needs the extra 'embedded'")
@pytest.mark.one_in(3)
@pytest.mark.parametrize("runner", ["node", "chromium", "wasmtime"])
def test_webassembly_has_the_same_bits(exported, runner, tmp_path):
    """Where an engine for it is installed; the frames reach both ends of every range."""
    one = exported["q15"].packaged("wasm")
    tool = shutil.which(runner)
    if (find_spec("wasmtime") if runner == "wasmtime" else tool) is None:
        pytest.skip(f"{runner} is not installed")
    one.write(tmp_path)
    zig = [sys.executable, "-P", "-m", "ziglang", "cc", "-target", "wasm32-freestanding"]
    options = ["-nostdlib", "-O2", "-Wl,--no-entry", "-o", "test.wasm", "wasm.c", "test.c"]
    run(*zig, *options, cwd=tmp_path)
    rng, program = np.random.default_rng(1), one.program
    inputs, outputs = program.of_kind("input"), program.of_kind("output")
    state, given, wanted = cleared(program, 1), [], []
    for number in range(12):
        numbers = {a.name: rng.integers(-(2**15), 2**15, (1, a.length)) for a in inputs}
        answers = Emulator(program).run(numbers, state, first=number == 0)
        given.append(packed(inputs, numbers, 1).tobytes())
        wanted.append(packed(outputs, answers, 1).tobytes())
    said = ["vector 0", *(",".join(map(str, answer)) for answer in wanted)]
    code = (tmp_path / "test.wasm").read_bytes()
    if runner == "wasmtime":
        assert by_wasmtime(code, given, len(wanted[0])) == [0, *wanted]
        return
    page = PAGE.replace("@code", b64encode(code).decode()).replace("@in", str(len(given[0])))
    page = page.replace("@frames", b64encode(b"".join(given)).decode())
    page = page.replace("@out", str(len(wanted[0])))
    if runner == "node":
        script = page.split("<script>")[1].split("</script>")[0]
        (tmp_path / "run.js").write_text(
            script.replace("const module", "const made").replace("module.", "made.")
        )
        assert run(tool, "run.js", cwd=tmp_path).strip() == " ".join(said)
        return
    (tmp_path / "run.html").write_text(page)
    flags = ["--headless", "--no-sandbox", "--disable-gpu", f"--user-data-dir={tmp_path}/user"]
    shown = run(tool, *flags, "--dump-dom", f"file://{tmp_path}/run.html", cwd=tmp_path)
    assert f"<body>{' '.join(said)}</body>" in shown


def by_wasmtime(code, given, size):
    import wasmtime

    store = wasmtime.Store()
    module = wasmtime.Instance(store, wasmtime.Module(store.engine, code), []).exports(store)
    memory, result = module["memory"], [module["vector"](store)]
    module["reset"](store)
    for frame in given:
        memory.write(store, frame, module["input"](store))
        module["step"](store)
        at = module["output"](store)
        result.append(bytes(memory.read(store, at, at + size)))
    return result


def test_platformio_compiles_the_program_alone(exported):
    files = exported["q15"].packaged("platformio").files
    build = json.loads(files["library.json"])["build"]
    assert build["srcFilter"] == ["-<*>", "+<test.c>"]
    assert "test.c" in files
    with pytest.raises(UnknownNameError, match="package 'maven'"):
        exported["q15"].packaged("maven")


def test_the_command_keeps_a_users_own_files(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    frames = np.random.default_rng(0).uniform(0.0, 4.0, (20, 2, 3))
    cnnum.Recording(frames, rate=80, unit="N", channels=("normal",)).save("like.npz")
    source = "import cnnum\n\n\n@cnnum.program\ndef most(frame):\n"
    (tmp_path / "own.py").write_text(source + '    return {"most": frame.normal.max()}\n')

    def export(kind):
        options = ["own.py:most", "--like", "like.npz", "--package", kind, "--out", kind]
        return CliRunner().invoke(main, ["export", *options])

    for kind in PACKAGES:
        for _ in range(2):  # the second replaces the first
            assert export(kind).exit_code == 0
    (tmp_path / "cmake" / "CMakeLists.txt").write_text("project(mine)\n")
    refused = export("cmake")
    assert refused.exit_code == 2
    assert "'CMakeLists.txt'" in refused.output
    assert (tmp_path / "cmake" / "CMakeLists.txt").read_text() == "project(mine)\n"
