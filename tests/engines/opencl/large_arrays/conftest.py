"""The program that most tests of large arrays run."""

import pytest

from cnnum import program, transient


@pytest.fixture
def states_of():
    """A function that returns the program of a transient, with its states and some figures."""

    def make(template, spec, figures, above=None):
        """Cells whose channel "m" is `above` a number are held, if one is given."""
        names = [f"x{layer}" for layer in range(template.layers)]

        @program
        def states(frame):
            maps = {"input": frame.channel("u"), "state": [frame.channel(each) for each in names]}
            if above is not None:
                maps["mask"] = frame.channel("m") > above
            if template.delayed is not None:
                maps["previous"] = frame.channel("before")
            found = transient(template, **maps, spec=spec)
            values = {figure: getattr(found, figure) for figure in figures}
            return dict(zip(names, found.states, strict=True)) | values

        return states

    return make
