"""An export as a package of a build system: what its files say, and where they lie."""

import json
import re
from collections.abc import Mapping
from dataclasses import dataclass

from cnnum.errors import name_error
from cnnum.version import __version__

MARK = "cnnum export"
"""Words by which a file of a package is known as written by an export."""


@dataclass(frozen=True, slots=True)
class Source:
    """An export that becomes a package.

    Attributes
    ----------
    name : str
        Name of the program in C.
    about : str
        The program in words.
    math : bool
        Whether it calls the mathematics library.
    vector : str
        Text of the test vector's main program.
    """

    name: str
    about: str
    math: bool
    vector: str

    @property
    def target(self) -> str:
        """Name of the package: that of a program alone may be a reserved word, such as "test"."""
        return f"cnnum_{self.name}"

    @property
    def version(self) -> str:
        """Three numbers, as all of these systems take them."""
        numbers = [*re.findall(r"\d+", __version__)[:3], "0", "0"][:3]
        return ".".join(numbers)


def _cmake(source: Source) -> dict[str, str]:
    name, target = source.name, source.target
    linked = f"target_link_libraries({target} PUBLIC m)\n" if source.math else ""
    return {
        "CMakeLists.txt": f"""# Written by {MARK}. Target {target}::{target}, by add_subdirectory or
# find_package({target}).
cmake_minimum_required(VERSION 3.13)
project({target} VERSION {source.version} LANGUAGES C)
include(GNUInstallDirs)

add_library({target} STATIC {name}.c)
add_library({target}::{target} ALIAS {target})
set_target_properties({target} PROPERTIES C_STANDARD 99 C_STANDARD_REQUIRED ON)
target_include_directories({target} PUBLIC
    $<BUILD_INTERFACE:${{CMAKE_CURRENT_SOURCE_DIR}}>
    $<INSTALL_INTERFACE:${{CMAKE_INSTALL_INCLUDEDIR}}>)
if(CMAKE_C_COMPILER_ID MATCHES "GNU|Clang")
    target_compile_options({target} PRIVATE -ffp-contract=off)
endif()
{linked}
if(CMAKE_SOURCE_DIR STREQUAL CMAKE_CURRENT_SOURCE_DIR)
    enable_testing()
    add_executable({target}_vector vector.c)
    target_link_libraries({target}_vector PRIVATE {target})
    add_test(NAME {target}_vector COMMAND {target}_vector)
endif()

install(TARGETS {target} EXPORT {target} ARCHIVE DESTINATION ${{CMAKE_INSTALL_LIBDIR}})
install(FILES {name}.h DESTINATION ${{CMAKE_INSTALL_INCLUDEDIR}})
install(EXPORT {target} NAMESPACE {target}:: FILE {target}Config.cmake
    DESTINATION ${{CMAKE_INSTALL_LIBDIR}}/cmake/{target})
"""
    }


def _arduino(source: Source) -> dict[str, str]:
    test = f"{source.target}_vector"
    return {
        "library.properties": f"""# Written by {MARK}.
name={source.target}
version={source.version}
author=cnnum
maintainer=cnnum
sentence={source.about}
paragraph=Call {source.name}_reset before the first frame, and {source.name}_step for each frame.
category=Data Processing
url=
architectures=*
includes={source.name}.h
""",
        # a sketch has a main function of its own
        "examples/self_test/vector.c": f"/* Written by {MARK}. */\n"
        + source.vector.replace("int main(void)", f"int {test}(void);\nint {test}(void)"),
        "examples/self_test/self_test.ino": f"""// Written by {MARK}: replays the test vector.
#include <{source.name}.h>

extern "C" int {test}(void);

void setup() {{
    Serial.begin(115200);
    Serial.println({test}() == 0 ? "The test vector passes." : "The answers differ.");
}}

void loop() {{
}}
""",
    }


def _platformio(source: Source) -> dict[str, str]:
    library = {
        "name": source.target,
        "version": source.version,
        "description": f"{source.about} Written by {MARK}.",
        "keywords": "tactile, cnn",
        "headers": f"{source.name}.h",
        "frameworks": "*",
        "platforms": "*",
        "build": {
            "srcDir": ".",
            "includeDir": ".",
            "srcFilter": ["-<*>", f"+<{source.name}.c>"],
        },
    }
    return {"library.json": json.dumps(library, indent=2) + "\n"}


def _zephyr(source: Source) -> dict[str, str]:
    name, target, here = source.name, source.target, "${CMAKE_CURRENT_LIST_DIR}"
    return {
        "zephyr/module.yml": f"""# Written by {MARK}: list this folder in ZEPHYR_EXTRA_MODULES.
name: {target}
build:
  cmake: zephyr
  kconfig: zephyr/Kconfig
""",
        "zephyr/CMakeLists.txt": f"""# Written by {MARK}.
if(CONFIG_{target.upper()})
  zephyr_library_named({target})
  zephyr_library_sources({here}/../{name}.c)
  zephyr_include_directories({here}/..)
endif()
""",
        "zephyr/Kconfig": f"""# Written by {MARK}.
config {target.upper()}
\tbool "{source.about}"
""",
    }


def _esp_idf(source: Source) -> dict[str, str]:
    return {
        "CMakeLists.txt": f"""# Written by {MARK}: a folder of 'components', or of
# EXTRA_COMPONENT_DIRS.
idf_component_register(SRCS "{source.name}.c" INCLUDE_DIRS ".")
""",
        "idf_component.yml": f"""# Written by {MARK}.
version: "{source.version}"
description: "{source.about}"
dependencies:
  idf: ">=4.1"
""",
    }


def _wasm(source: Source) -> dict[str, str]:
    name = source.name
    # the mathematics library comes with WASI; whole numbers need none
    target = "wasm32-wasi -mexec-model=reactor" if source.math else "wasm32-freestanding -nostdlib"
    return {
        "wasm.c": f"""/* Written by {MARK}: the program as a module of WebAssembly.

   python -m ziglang cc -target {target} -O2
       -ffp-contract=off -Wl,--no-entry -o {name}.wasm wasm.c {name}.c

   The frame is written to the module's memory at input(), and the answers are read at output(),
   as export.json lays them out, little-endian. vector() replays the test vector: 0 if it passes. */
#include "{name}.h"

#define EXPORTED(name) __attribute__((export_name(#name)))
#define main vector_of_program
int vector_of_program(void);
#include "vector.c"
#undef main

static {name}_memory kept;
static {name}_input frame;
static {name}_output answers;

EXPORTED(reset) void wasm_reset(void);
EXPORTED(input) {name}_input *wasm_input(void);
EXPORTED(output) {name}_output *wasm_output(void);
EXPORTED(step) void wasm_step(void);
EXPORTED(vector) int wasm_vector(void);

void wasm_reset(void)
{{
    {name}_reset(&kept);
}}

{name}_input *wasm_input(void)
{{
    return &frame;
}}

{name}_output *wasm_output(void)
{{
    return &answers;
}}

void wasm_step(void)
{{
    {name}_step(&kept, &frame, &answers);
}}

int wasm_vector(void)
{{
    return vector_of_program();
}}
"""
    }


_KINDS = {
    "cmake": _cmake,
    "arduino": _arduino,
    "platformio": _platformio,
    "zephyr": _zephyr,
    "esp-idf": _esp_idf,
    "wasm": _wasm,
}

PACKAGES = tuple(_KINDS)

FOLDERS = {"arduino": "src/"}
"""Where the program's own two files lie; else beside the others. Arduino compiles all C of a folder
that has no 'src', and so two main functions."""


def package_files(kind: str, source: Source) -> Mapping[str, str]:
    """Return the files of a package, by their places.

    Raises
    ------
    UnknownNameError
        If there is no such kind.
    """
    if kind not in _KINDS:
        raise name_error("package", kind, PACKAGES)
    return _KINDS[kind](source)
