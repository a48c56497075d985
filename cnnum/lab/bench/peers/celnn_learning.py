"""celnn's two ways to learn a template from pictures: its genetic algorithm, and its gradients."""

from dataclasses import dataclass
from importlib import import_module
from typing import Any

import numpy as np

from cnnum.arrays import Floats
from cnnum.errors import CnnumError, missing_extra

STEPS, STEP = 20, 0.1
"""Euler's steps of a run, and their length in time constants."""

RATE, UPDATES = 0.05, 200
"""Of Adam, as PyTorch has it: its rate, and how many updates."""

EXTRAS = {"deap": "celnn[ga]", "torch": "celnn[torch]"}
"""Of celnn, that install a package."""

PARTS = ("deap.base", "deap.creator", "deap.tools")
"""Of DEAP, that celnn imports amid a run."""


@dataclass(frozen=True, slots=True, eq=False)
class Task:
    """A template of celnn's that is to be found again from one picture and its output.

    Attributes
    ----------
    name : str
    input, target : (rows, cols) or (cells,) float
    size : int
        Size of the kernels.
    """

    name: str
    input: Floats
    target: Floats
    size: int


PICTURES = (
    ("image_processing", "EDGE_DETECTION"),
    ("image_processing", "INVERSION"),
    ("image_processing", "CORNER_DETECTION"),
    ("image_processing", "DIAGONAL_LINE_DETECTION"),
    ("image_processing", "SMOOTHING_DEMO"),
    ("image_processing", "SHARPENING_DEMO"),
    ("diffusion", "TWO_D_LAPLACIAN_DEMO"),
)
SIGNALS = (("diffusion", "ONE_D_DIFFUSION"), ("logic", "NOT_DEMO"), ("logic", "THRESHOLD_DEMO"))
BINARY = ("DETECTION", "INVERSION")


def tasks(*, signals: bool) -> list[Task]:
    """Return celnn's own templates with their answers to a random picture, or to a signal.

    Parameters
    ----------
    signals : bool
        One-dimensional ones, which are all that celnn has gradients of.
    """
    rng, result = np.random.default_rng(0), list[Task]()
    for module, name in SIGNALS if signals else PICTURES:
        template = getattr(_module(f"celnn.templates.{module}"), name)
        picture = rng.uniform(-1.0, 1.0, 64 if signals else (16, 16))
        if name.endswith(BINARY):
            picture = np.where(picture > 0.0, 1.0, -1.0)
        output = np.asarray(_network(picture, template).run(_config()).output)
        result.append(Task(template.name, picture, output, np.shape(template.feedback)[0]))
    return result


def genetic(task: Task) -> tuple[float, int]:
    """Return the loss that the genetic algorithm ends at, as it is by default, and its runs."""
    for part in PARTS:
        _module(part)
    training, form = _module("celnn.training"), _form(task)
    data = training.TrainingDataset.from_pairs([task.input], [task.target])
    trainer = training.GATrainer(form, data, _config(), boundary="mirror", seed=0)
    result = trainer.run()
    return float(result.best_fitness), int(result.n_evaluations)


def gradients(task: Task) -> tuple[float, int]:
    """Return the least loss of Adam over celnn's differentiable network, and its runs."""
    torch, module = _module("torch"), _module("celnn.differentiable")
    torch.manual_seed(0)
    network = module.DifferentiableCellularNetwork(
        task.size // 2, boundary="mirror", dt=STEP, steps=STEPS
    ).double()
    with torch.no_grad():
        for parameter in network.parameters():
            parameter.normal_(0.0, 0.5)
    optimiser = torch.optim.Adam(network.parameters(), lr=RATE)
    signal, target = torch.as_tensor(task.input), torch.as_tensor(task.target)
    least = np.inf
    for _ in range(UPDATES):
        optimiser.zero_grad()
        loss = ((torch.clamp(network(signal), -1.0, 1.0) - target) ** 2).mean()
        loss.backward()
        least = min(least, float(loss.detach()))
        optimiser.step()
    return least, UPDATES


def judged(task: Task, A: Floats, B: Floats, z: float) -> float:
    """Return the loss of weights as celnn's own network has it."""
    template = _module("celnn").Template("judged", feedback=A, control=B, bias=z)
    output = np.asarray(_network(task.input, template).run(_config()).output)
    return float(np.mean((output - task.target) ** 2))


def _form(task: Task) -> Any:
    zeros = np.zeros((task.size,) * task.input.ndim)
    return _module("celnn").Template("form", feedback=zeros, control=zeros, bias=0.0)


def _network(picture: Floats, template: Any) -> Any:
    return _module("celnn").CellularNetwork(
        picture,
        feedback=template.feedback,
        control=template.control,
        bias=template.bias,
        boundary="mirror",
    )


def _config() -> Any:
    return _module("celnn").SimulationConfig(t_end=STEPS * STEP, dt=STEP, solver="euler")


def _module(name: str) -> Any:
    """Return a module; a package that is not there is another fault than one in pieces."""
    package = name.partition(".")[0]
    extra = EXTRAS.get(package, "celnn")
    try:
        import_module(package)
        return import_module(name)
    except (ImportError, OSError) as error:  # OSError is PyTorch's, of a library that is gone
        if isinstance(error, ModuleNotFoundError) and error.name == package:
            raise missing_extra("learning as celnn does", extra, "race") from None
        raise CnnumError(
            f"'{package}' is installed, but cannot be imported ({error}): install it again with "
            f"\"pip install --force-reinstall '{extra}'\"."
        ) from error


__all__ = ["STEP", "STEPS", "Task", "genetic", "gradients", "judged", "tasks"]
