"""The bench of a template: a page that shows it at work, and answers to what the page asks.

A question is a JSON object with `do`, the number `id` and a template as the page holds it. The
answer to "run" is a head of JSON, its length before it as u32, and the states of its `times` (2 are
the start and the one numbered `moment`) as little-endian float32; every other answer is JSON. A
page has one question of a kind on its way.
"""

import asyncio
import contextlib
import json
import math
import struct
from base64 import b64decode, b64encode
from collections.abc import Callable, Mapping
from dataclasses import asdict, replace
from threading import Lock
from typing import TYPE_CHECKING, Any, cast

import numpy as np

from cnnum.arrays import Floats
from cnnum.design.designing import Spec, designed
from cnnum.design.finding import compare, figures
from cnnum.engine import Engine
from cnnum.errors import CnnumError, TemplateError
from cnnum.live.feeds import Feed
from cnnum.live.server import Door, Place
from cnnum.templating.batch import TemplateBatch
from cnnum.templating.checks.robustness import Judge, coarse, flips, mismatched, wilson
from cnnum.templating.files.entry import Entry
from cnnum.templating.files.toml_format import entry_to_toml
from cnnum.templating.library import get_entry, template_names
from cnnum.templating.template import Check, Template

if TYPE_CHECKING:
    from websockets.asyncio.server import ServerConnection

FILES = ("studio.html", "studio.css", "studio.js")

TIMES = 33
"""Number of times in a film, including the start."""

STEPS, LONGEST_STEP = 128, 0.08
"""Of a film: the least number of steps, and the longest step in τ. On the 64×64 cells of `HOLE`,
where waves of changes sharpen every error, outputs are then within 0.03 of those of a finer run."""

STABLE = 1.3
"""Of the longest step times the quickest rate, which Gershgorin's discs bound by (1 + Σ|A|)/τ.
Runge–Kutta steps are stable up to 2.6 of any rate that does not grow."""

MOST_STEPS = 20_000

HEAVIEST = 1e9
"""Largest number of A, B and z that is run, so that states are numbers of float32."""

SIDE = 128
"""Cells along the longest side of a picture."""

LENGTH = struct.Struct("<I")

SETTLES = 30.0
"""τ of a film where the template says no duration; it ends sooner where the array rests."""

NEAREST = 6
"""Neighbourhoods that are shown."""

DRAWS, COUPLED_DRAWS = 200, 20
"""Chips of one mismatch, on all neighbourhoods and on the picture where cells are coupled."""

MOST_BITS = 16
"""Most bits of a weight that can be chosen; more are as good as exact."""

AT_WORK = 8
"""Questions of a page that are worked on; more of them wait. A page has one of each kind."""

_BITS = np.arange(512)[:, np.newaxis] >> np.arange(9) & 1
NEIGHBOURHOODS: Floats = np.where(_BITS == 1, 1.0, -1.0).reshape(-1, 3, 3)


def template_of(given: Mapping[str, Any]) -> Template:
    """Return the template that a page holds.

    Raises
    ------
    CnnumError
        If it is none.
    """
    try:
        rule = str(given.get("rule") or "")
        template = Template(
            given["name"] or "untitled",
            given["A"],
            given["B"] if given.get("B") else None,
            given["z"],
            tau=given.get("tau", 1.0),
            boundary=given.get("boundary", 0.0),
            input_boundary=given.get("input_boundary"),
            initial=given.get("initial", 0.0),
            duration=given.get("duration", "settle"),
            description=str(given.get("description") or ""),
            source=str(given.get("source") or ""),
            check=Check("rule", (("rule", rule),)) if rule else None,
        )
    except (KeyError, TypeError) as error:
        raise TemplateError(f"The page's template lacks a number: {error}.") from None
    page_of(template)  # others are too large to be answered at once
    return template


def page_of(template: Template) -> dict[str, Any]:
    """Return a template as the page holds it.

    Raises
    ------
    TemplateError
        If the page has no fields for it.
    """
    fits = template.layers == 1 and template.inputs <= 1 and template.radius <= 1
    alike = template.plain and template.output.name == "standard" and not template.needs_state
    if not (fits and alike):
        raise TemplateError(
            f"'{template.name}' cannot be shown: the studio supports templates of one layer and "
            "one picture, with linear couplings of 3×3 cells and the standard output."
        )
    check = template.check
    rule = dict(check.parameters).get("rule", "") if check and check.name == "rule" else ""
    return {
        "name": template.name,
        "A": _three(template.A[0, 0]),
        "B": _three(template.B[0, 0]) if template.inputs else None,
        "z": float(template.z[0]),
        "tau": float(template.tau[0]),
        "boundary": template.boundary.name,
        "input_boundary": template.input_boundary.name,
        "initial": template.initial,
        "duration": template.duration,
        "description": template.description,
        "source": template.source,
        "rule": rule,
    }


def _three(kernel: Floats) -> list[list[float]]:
    return [list(row) for row in np.pad(kernel, (3 - len(kernel)) // 2).tolist()]


def picture_of(given: Mapping[str, Any]) -> Floats:
    """Return the picture of a page, whose cells are bytes from −100 (white) to 100.

    Raises
    ------
    TemplateError
        If it is none.
    """
    try:
        rows, cols = int(given["rows"]), int(given["cols"])
        cells = np.frombuffer(b64decode(given["picture"], validate=True), np.int8)
        fits = min(rows, cols) >= 1 and max(rows, cols) <= SIDE and len(cells) == rows * cols
    except (KeyError, TypeError, ValueError, OverflowError):
        fits, rows, cols, cells = False, 1, 1, np.zeros(1, np.int8)
    if not fits:
        raise TemplateError(f"A picture may have up to {SIDE}×{SIDE} cells, with one byte each.")
    return np.clip(cells.reshape(rows, cols) / 100.0, -1.0, 1.0)


def maps_of(template: Template, picture: Floats) -> dict[str, Any]:
    """Return the maps of a run on one picture: the input, or the start of one without an input."""
    return {"input": picture} if template.inputs else {"state": picture}


def steps_of(template: Template) -> tuple[float, int]:
    """Return the end of a film and its number of steps.

    Raises
    ------
    TemplateError
        If these are too many to be waited for.
    """
    tau = float(template.tau.max())
    end = SETTLES * tau if template.duration == "settle" else template.duration
    quickest = (1.0 + float(np.abs(template.A).sum())) / float(template.tau.min())
    longest = min(STABLE / quickest, LONGEST_STEP * tau, end)
    least = end / longest if longest else math.inf
    if not least <= MOST_STEPS:
        raise TemplateError(
            f"A run of {template.timed(end)} needs more than {MOST_STEPS:,} steps: shorten its "
            "duration, or make its weights smaller."
        )
    return end, max(STEPS, (TIMES - 1) * math.ceil(least / (TIMES - 1)))


def runnable(given: Mapping[str, Any]) -> Template:
    """Return the template that a page holds, if it can be run while the page waits.

    Raises
    ------
    TemplateError
        If it is none, or takes too long.
    """
    template = template_of(given)
    heaviest = max(float(np.abs(k).max(initial=0.0)) for k in (template.A, template.B, template.z))
    if heaviest > HEAVIEST:
        raise TemplateError(f"A weight is {heaviest:.3g}: the studio runs up to {HEAVIEST:g}.")
    steps_of(template)
    return template


def film(
    engine: Engine, template: Template, picture: Floats, moment: int | None = None
) -> tuple[dict[str, Any], Floats]:
    """Return the head of a film, and its states (times, rows, cols), at one moment or at all.

    Its steps are fixed, so that a film comes at once. The end is judged by `facts`.
    """
    end, steps = steps_of(template)
    times = np.linspace(0.0, end, TIMES)
    if moment is not None:
        times = times[[0, moment]]
    maps = maps_of(template, picture)
    run = engine.run(template, **maps, at=times[1:], method="rk4", dt=end / steps)
    start = picture if not template.inputs or template.initial == "input" else template.initial
    first = np.broadcast_to(np.asarray(start, np.float64), picture.shape)
    states = np.concatenate([first[np.newaxis], run.state])
    return {"times": times.tolist(), "end": end, "step": end / steps}, states


def alone(template: Template) -> bool:
    """Return whether no cell's state depends on another's, so that 512 neighbourhoods are all."""
    feedback = template.A[0, 0].copy()
    feedback[len(feedback) // 2, len(feedback) // 2] = 0.0
    return not feedback.any() and template.inputs == 1


def margins(control: Floats, bias: Floats, own: Floats, initial: float | str) -> Floats:
    """Return how clearly uncoupled templates decide all 512 neighbourhoods, black above 0.

    A cell τ dx/dt = −x + a f(x) + w, with the drive w = Σ B u + z, goes up from x₀ where w is above
    −(a − 1) x₀, or above 0 where a is at most 1. The margin is w less that.

    Parameters
    ----------
    control : (..., 3, 3) float
    bias, own : (...) float
        z and a.
    initial : float or "input"

    Returns
    -------
    (..., 512) float
    """
    start = NEIGHBOURHOODS[:, 1, 1] if initial == "input" else np.clip(float(initial), -1.0, 1.0)
    drive = control.reshape(*control.shape[:-2], 9) @ NEIGHBOURHOODS.reshape(512, 9).T
    held = np.maximum(np.asarray(own) - 1.0, 0.0)
    return drive + np.asarray(bias)[..., np.newaxis] + held[..., np.newaxis] * start


def margins_of(template: Template, width: float = 0.0, draws: int = 1) -> Floats:
    """Return the margins (draws, 512) of an uncoupled template whose numbers are off at random."""
    rng = np.random.default_rng(0)
    page = page_of(template)
    numbers = [np.array(page["B"]), np.array(page["z"]), np.array(page["A"])[1, 1]]
    control, bias, own = (v * (1.0 + width * rng.normal(size=(draws, *v.shape))) for v in numbers)
    return margins(control, bias, own, template.initial)


def nearest(template: Template) -> list[dict[str, Any]]:
    """Return the neighbourhoods of an uncoupled template that flip first, the nearest one first.

    A number of size |v| in B or z that is off by itself flips the cell at the share margin/|v|, so
    the largest one of them is the weakest.
    """
    control, bias = np.array(page_of(template)["B"]), float(template.z[0])
    (found,) = margins_of(template)
    read = control != 0.0
    read[1, 1] |= template.initial == "input"
    order = np.argsort(np.abs(found), kind="stable")
    numbers = {f"B[{i}, {j}]": abs(v) for (i, j), v in np.ndenumerate(control)} | {"z": abs(bias)}
    weakest = max(numbers, key=lambda name: numbers[name])
    result, seen = list[dict[str, Any]](), set[bytes]()
    for at in order.tolist():
        shown = np.where(read, NEIGHBOURHOODS[at], 0.0)  # cells of no weight do not matter
        if shown.tobytes() in seen:
            continue
        seen.add(shown.tobytes())
        margin, size = float(found[at]), numbers[weakest]
        share = abs(margin) / size if size else math.inf
        result.append(
            {
                "cells": shown.tolist(),
                "margin": margin,
                "weakest": weakest,
                "share": share if math.isfinite(share) else None,
            }
        )
        if len(result) == NEAREST:
            break
    return result


class Studio(Door):
    """Answers the page of templates.

    Parameters
    ----------
    place : Place
    entry : Entry
        Library entry of the template that the page shows first.
    feed : Feed, optional
        An array, scene or recording whose loads are the picture.
    """

    longest = 1 << 17

    def __init__(self, place: Place, entry: Entry, feed: Feed | None = None) -> None:
        super().__init__(place, FILES)
        self._feed, self._peak = feed, 0.0
        self._first = page_of(entry.template)
        self._known = {entry.template.digest: entry}
        # films, and what an array says, never wait for what takes longer
        self._engine, self._slow = (Engine("numba") for _ in range(2))
        self._quick = {"run": Lock(), "live": Lock()}
        self._lock = Lock()
        self._answers: dict[str, Callable[[Mapping[str, Any]], dict[str, Any] | bytes]] = {
            "run": self._run,
            "facts": self._facts,
            "flips": self._flips,
            "design": self._design,
            "compare": self._compare,
            "load": self._load,
            "save": self._save,
            "live": self._live,
        }

    async def talk(self, connection: "ServerConnection") -> None:
        """Give a page its template, and answer its questions until it leaves."""
        from websockets.exceptions import ConnectionClosed

        with contextlib.suppress(ConnectionClosed):
            hello = {
                "kind": "hello",
                "template": self._first,
                "names": template_names(),
                "live": self._feed is not None,
            }
            await connection.send(json.dumps(hello))
            at_work = set[asyncio.Task[None]]()
            async for message in connection:
                task = asyncio.create_task(self._send_reply(connection, message))
                at_work.add(task)
                task.add_done_callback(at_work.discard)
                if len(at_work) >= AT_WORK:
                    await asyncio.wait(at_work, return_when=asyncio.FIRST_COMPLETED)

    async def _send_reply(self, connection: "ServerConnection", message: str | bytes) -> None:
        from websockets.exceptions import ConnectionClosed

        with contextlib.suppress(ConnectionClosed):
            await connection.send(await asyncio.to_thread(self.reply, message))

    def reply(self, message: str | bytes) -> str | bytes:
        """Return the answer to a question; one of an error holds its sentence."""
        try:
            asked = json.loads(message)
            head: dict[str, Any] = {"do": str(asked["do"]), "id": int(asked["id"])}
            answer = self._answers[head["do"]]
        except (ValueError, LookupError, TypeError, OverflowError, RecursionError):
            return json.dumps({"do": "", "id": 0, "error": "This question is malformed."})
        try:
            with self._quick.get(head["do"], self._lock):
                found = answer(cast("dict[str, Any]", asked))
        except CnnumError as error:
            found = {"error": str(error)}
        except (ValueError, LookupError, TypeError, AttributeError, OverflowError):
            found = {"error": "This question lacks a part."}
        if isinstance(found, bytes):
            (length,) = LENGTH.unpack_from(found)
            own, states = json.loads(found[4 : 4 + length]), found[4 + length :]
            text = json.dumps(head | own).encode()
            text += b" " * (-(len(text) + 4) % 4)  # the page reads the states in place
            return LENGTH.pack(len(text)) + text + states
        return json.dumps(head | found)

    def _run(self, asked: Mapping[str, Any]) -> bytes:
        template, picture = runnable(asked["template"]), picture_of(asked)
        moment = int(asked["moment"]) if "moment" in asked else None
        if moment is not None and not 1 <= moment < TIMES:
            raise TemplateError(f"A film has the moments 1 to {TIMES - 1}, got {moment}.")
        head, states = film(self._engine, template, picture, moment)
        shape = {"rows": picture.shape[0], "cols": picture.shape[1]}
        text = json.dumps(head | shape).encode()
        return LENGTH.pack(len(text)) + text + states.astype("<f4").tobytes()

    def _facts(self, asked: Mapping[str, Any]) -> dict[str, Any]:
        """Return the class, the end by the chosen method, the margins, and what the rule says."""
        template, picture = runnable(asked["template"]), picture_of(asked)
        known, run = figures(template), self._slow.run(template, **maps_of(template, picture))
        facts: dict[str, Any] = {
            "stability": known.stability,
            "why": known.why,
            "products": known.products,
            "once": known.once,
            "settled": bool(run.settled),
            "time": float(np.max(run.time)),
            "black": int((run.output > 0.0).sum()),
            "nearest": nearest(template) if alone(template) else None,
        }
        if template.check is not None:
            facts["wrong"] = Judge(template, self._slow).wrong(template)
        return facts

    def _flips(self, asked: Mapping[str, Any]) -> dict[str, Any]:
        """Return how many of many chips have a wrong cell; their numbers have some bits."""
        template, width = runnable(asked["template"]), float(asked["mismatch"])
        bits = int(asked.get("bits") or 0)
        if bits and not 2 <= bits <= MOST_BITS:
            raise TemplateError(f"Numbers have 2 to {MOST_BITS} bits, or 0 for all, got {bits}.")
        made = coarse(template, bits) if bits else template
        if not 0.0 <= width <= 1.0:
            raise TemplateError(f"A mismatch is a share from 0 to 1, got {width:g}.")
        if template.check is not None:
            (found,) = flips(made, self._slow, mismatches=[width], bits=(), draws=DRAWS)
            kept = ("flipped", "low", "high", "draws")
            return {key: asdict(found)[key] for key in kept} | {"of": "the rule"}
        if alone(template):
            (right,), chips = margins_of(template), margins_of(made, width, DRAWS)
            wrong, of = (chips > 0.0) != (right > 0.0), "its own answers to all 512 neighbourhoods"
        else:
            picture, rng = picture_of(asked), np.random.default_rng(0)
            maps = maps_of(template, picture)
            batch = TemplateBatch.of([mismatched(made, rng, width) for _ in range(COUPLED_DRAWS)])
            outputs = [self._slow.run(each, **maps).output for each in (template, batch)]
            wrong, of = (outputs[1] > 0.0) != (outputs[0] > 0.0), "this picture"
        many = len(wrong)
        hits = int(wrong.reshape(many, -1).any(axis=1).sum())
        low, high = wilson(hits, many)
        return {"flipped": hits / many, "low": low, "high": high, "draws": many, "of": of}

    def _design(self, asked: Mapping[str, Any]) -> dict[str, Any]:
        """Return the template with the largest margin that follows a rule, and its proof."""
        wanted = Spec(str(asked.get("name") or "untitled"), rule=str(asked["rule"]), mismatch=())
        (made,) = designed(wanted, self._slow)
        self._known[made.entry.template.digest] = made.entry
        proof = made.entry.proof
        return {
            "template": page_of(made.entry.template),
            "relative": proof.relative_margin if proof else None,
            "worst": proof.worst_case if proof else None,
        }

    def _compare(self, asked: Mapping[str, Any]) -> dict[str, Any]:
        first, second = runnable(asked["template"]), runnable(asked["other"])
        found = compare(first, second, engine=self._slow)
        shown = found.inputs[:12] if found.exhaustive else found.inputs[:0]
        return {
            "exhaustive": found.exhaustive,
            "cases": found.cases,
            "unlike": found.unlike,
            "differs": sorted(found.differs),
            "inputs": shown.tolist(),
            "answers": (found.answers[:, : len(shown)] > 0.0).tolist() if len(shown) else [],
        }

    def _load(self, asked: Mapping[str, Any]) -> dict[str, Any]:
        entry = get_entry(str(asked.get("name")))
        page = page_of(entry.template)
        self._known[entry.template.digest] = entry
        return {"template": page}

    def _live(self, asked: Mapping[str, Any]) -> dict[str, Any]:
        """Return the newest loads as a picture: 0 is white, the largest one so far black."""
        if self._feed is None:
            raise TemplateError("No array is connected: start the studio with --live SOURCE.")
        hub = self._feed.hubs[0]
        if hub.newest is None:
            return {"number": -1, "ended": hub.ended}
        load = np.abs(hub.loads(hub.newest)[2])[:SIDE, :SIDE]
        self._peak = max(self._peak, float(load.max()))
        share = load / self._peak if self._peak else load
        cells = np.rint(200.0 * share - 100.0).astype(np.int8)
        rows, cols = cells.shape
        picture = {"rows": rows, "cols": cols, "picture": b64encode(cells.tobytes()).decode()}
        return {"number": hub.newest.number, "ended": hub.ended, **picture}

    def _save(self, asked: Mapping[str, Any]) -> dict[str, Any]:
        """Return TOML; what was known of the same numbers and the same rule stays with them."""
        template = template_of(asked["template"])
        known = self._known.get(template.digest)
        if known is None or page_of(known.template)["rule"] != (
            asked["template"].get("rule") or ""
        ):
            return {"toml": entry_to_toml(Entry(template))}
        kept = replace(template, check=known.template.check)
        return {"toml": entry_to_toml(replace(known, template=kept, aliases=()))}
