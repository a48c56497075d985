"""Conway's game of life: two counts by a template of two layers, then local logic, in a loop."""

from collections.abc import Mapping

from cnnum.programs import program
from cnnum.programs.fields import Field
from cnnum.programs.loops import loop
from cnnum.programs.machine import FrameFields
from cnnum.programs.transients import transient
from cnnum.templating.library import get_template


@program
def life(frame: FrameFields, *, generations: int = 1) -> Mapping[str, Field]:
    """Play the game of life from a picture, with dead cells beyond its rim.

    Returns
    -------
    picture : logic map of the cells that are alive at the end.
    still : flag; the game became stationary before the last generation.
    """
    counts = get_template("LIFE_1")

    def next_generation(alive: Field) -> Field:
        few, alone = transient(counts, input=alive.picture()).outputs
        return few.black() & ~alone.black()

    game = loop(next_generation, frame.channel("picture").black(), limit=generations)
    return {"picture": game.value, "still": game.finished}
