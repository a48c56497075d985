"""The public interface: signatures that can be read, names wherever objects are taken."""

import inspect
from pathlib import Path

import numpy as np
import pytest

import cnnum
from cnnum.errors import TemplateError, UnknownNameError

LONGEST = 1000
"""Signs of a signature; that of Engine.run, with 15 arguments, has 640."""


def callables():
    for name in cnnum.__all__:
        thing = getattr(cnnum, name)
        if callable(thing):
            yield name, thing
        if inspect.isclass(thing):
            members = ((key, value) for key, value in vars(thing).items() if key[0] != "_")
            yield from ((f"{name}.{key}", value) for key, value in members if callable(value))


def test_signatures_can_be_read():
    long = {}
    for name, thing in callables():
        try:
            shown = str(inspect.signature(thing))
        except (TypeError, ValueError):  # of a builtin that a class inherits
            continue
        if "_typing" in shown or len(shown) > LONGEST:
            long[name] = shown[:200]
    assert not long


def test_the_stub_hides_no_name():
    """A module-level __getattr__ in the stub would let type checkers accept every name."""
    stub = Path(cnnum.__file__).with_suffix(".pyi").read_text()
    assert "__getattr__" not in stub
    with pytest.raises(AttributeError, match="nope"):
        _ = cnnum.nope


ENGINE = cnnum.Engine("reference")
PICTURE = np.where(np.eye(8) > 0, 1.0, -1.0)


@cnnum.program
def by_name(frame):
    return {"edge": cnnum.apply("edge", input=frame.normal)}


@cnnum.program
def by_object(frame):
    return {"edge": cnnum.apply(cnnum.get_template("EDGE"), input=frame.normal)}


def ran(program):
    plan = ENGINE.compile(program, shape=(8, 8), channels=("normal",))
    return plan(PICTURE[..., np.newaxis])["edge"]


def saved(template, path):
    cnnum.save_template(template, path)
    return cnnum.load_template(path)


TAKES = {
    "run": lambda t, _: ENGINE.run(t, input=PICTURE).output,
    "analyse": lambda t, _: cnnum.analyse(t),
    "stability_bound": lambda t, _: cnnum.stability_bound(t, (8, 8), "euler"),
    "TemplateBatch": lambda t, _: cnnum.TemplateBatch(t, z=[-1.0, -0.5]),
    "save_template": lambda t, path: saved(t, path / f"{type(t).__name__}.toml"),
}


@pytest.mark.parametrize("call", TAKES)
def test_a_name_stands_for_the_library_s_template(call, tmp_path):
    named, given = (TAKES[call](t, tmp_path) for t in ("edge", cnnum.get_template("EDGE")))
    assert np.array_equal(named, given) if call == "run" else named == given
    with pytest.raises(UnknownNameError, match="'edges'"):
        TAKES[call]("edges", tmp_path)
    with pytest.raises(TemplateError, match="template or the name of one"):
        TAKES[call](3, tmp_path)


def test_programs_take_names_of_templates_and_engines_of_programs():
    assert np.array_equal(ran(by_name), ran(by_object))
    assert np.any(ran(by_name) != ran(by_name).flat[0])
    assert ENGINE.compile("contact", shape=(5, 5)).program == "contact"
    with pytest.raises(UnknownNameError, match="program 'lives'"):
        ENGINE.compile("lives", shape=(5, 5))


def test_scenes_have_names_as_templates_and_programs_do():
    assert "contact" in cnnum.scene_names()
    with cnnum.get_scene("contact") as scene:
        assert scene.spec.name == "contact"
    with pytest.raises(UnknownNameError, match=r"scene 'contacts'.*did you mean 'contact'"):
        cnnum.get_scene("contacts")


def test_a_plan_offers_no_internals_at_the_prompt():
    plan = ENGINE.compile("contact", (8, 8))
    offered = {name for name in dir(plan) if not name.startswith("_")}
    assert offered == {
        "program", "engine", "device", "precision", "schedule", "source",
        "explain", "plot", "stream", "trace", "warm_up",
    }  # fmt: skip
    assert all(getattr(plan, name) is not None for name in offered)
