"""Lowering of a schedule to a program in fixed or floating point, level by level."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace

from cnnum import kernels as ir
from cnnum.embedded.arithmetic import (
    LOGIC,
    Fixed,
    Quantity,
    Reals,
    applied,
    call,
    constant,
    opposite,
)
from cnnum.embedded.formats import Formats, Sizes
from cnnum.embedded.lowering.builder import FINE, Builder
from cnnum.embedded.lowering.transients import lower_transient
from cnnum.embedded.program import UNFINISHED, Array, IntegerProgram, array_names
from cnnum.errors import NotSupportedError
from cnnum.graph.elementwise import MULTIPLY
from cnnum.graph.nodes import (
    Apply,
    Constant,
    ConstantMap,
    FirstFrame,
    Input,
    Loop,
    Memory,
    Node,
    Parameter,
    Pick,
    Read,
    Reduce,
    Transient,
    picks_of,
)
from cnnum.graph.schedule import Schedule
from cnnum.integrators.solver import Solver

MISSED = ir.Name("missed", LOGIC)
"""Whether a loop of the frame reached its iteration limit."""


@dataclass(frozen=True, slots=True)
class Carried:
    """A loop-carried value: a map in an array, or a number in a variable.

    Attributes
    ----------
    array : Array
        The stored array; for a number, its format and name.
    scalar : bool
    """

    array: Array
    scalar: bool


def lower_loop(work: "Lowering", node: Node) -> None:
    """Write a loop; its results that are read become known to the work.

    Raises
    ------
    NotSupportedError
        If something in it has no form in whole numbers.
    """
    loop, to = node.operation, work.to
    assert isinstance(loop, Loop)
    start, *rest = node.arguments
    carried = [
        _carried(work, f"c{node.index}_{k}", first, result)
        for k, (first, result) in enumerate(zip(rest, loop.results, strict=False))
    ]
    running = ir.Name(f"running{node.index}", LOGIC)
    rounds = ir.Name(f"rounds{node.index}", (0, loop.limit))
    to.body += [ir.declare(running, _flag(work, start)), ir.declare(rounds, 0)]
    with to.within() as body:
        again = _round(work, node, carried, rest[len(loop.results) :])
        more = call("add", rounds, ir.Integer(1))
        to.body.append(ir.Assign(rounds, call("minimum", more, ir.Integer(loop.limit))))
        to.body.append(ir.Assign(running, again))
    to.body.append(ir.Counted(ir.ROUND, 0, loop.limit, running, tuple(body)))
    if _may_not_finish(node, work.schedule.nodes):
        to.body.append(ir.Assign(MISSED, call("or", MISSED, running)))
    _picked(work, node, carried, running, rounds)


def _may_not_finish(node: Node, nodes: Iterable[Node]) -> bool:
    """Return whether a loop may reach its limit without any operation checking for it."""
    assert isinstance(node.operation, Loop)
    again = node.operation.again
    constant = None if again is None else again.operation
    at_once = isinstance(constant, Constant) and constant.value == 0.0  # a branch
    return not at_once and all(pick.what != "finished" for _, pick in picks_of(node, nodes))


def may_not_finish(nodes: Sequence[Node]) -> bool:
    """Return whether such a loop is among operations, or in the body of one."""
    return any(
        isinstance(node.operation, Loop)
        and (_may_not_finish(node, nodes) or may_not_finish(node.operation.nodes))
        for node in nodes
    )


def _flag(work: "Lowering", node: Node) -> ir.Expression:
    quantity = work.numbers[node.index]
    return quantity.value if quantity.exact is None else ir.Integer(int(quantity.exact != 0))


def _carried(work: "Lowering", name: str, start: Node, result: Node) -> Carried:
    """Write the value before the first iteration."""
    to, logic = work.to, start.logic and result.logic
    if result.scalar:
        form = to.formats.register(name)
        array = Array(name, "work", 0, None if logic else form, logic=logic)
        begun = to.stored(work.numbers[start.index], array)
        to.body.append(ir.declare(ir.Name(name, array.bounds or begun.bounds), begun))
        to.fractions[name] = 0 if array.format is None else array.format.fraction
        return Carried(array, scalar=True)
    form = to.formats.kept(name)
    array = to.array(name, "work", to.cells, form, "carried by a loop", logic=logic)
    known = dict(work.numbers)
    with to.within() as body:
        to.store(array, work.operand(start))
    work.numbers = known
    to.loop(body)
    return Carried(array, scalar=False)


def _round(
    work: "Lowering", node: Node, carried: list[Carried], captured: list[Node]
) -> ir.Expression:
    """Write an iteration; return whether another one follows."""
    loop, to = node.operation, work.to
    assert isinstance(loop, Loop)
    results = [*loop.results, *([] if loop.again is None else [loop.again])]
    inner = work.body_of(replace(work.schedule, nodes=loop.nodes, outputs={}, memories={}), results)
    for number, parameter in loop.captured.items():
        outer = captured[number]
        if outer.scalar:
            inner.numbers[parameter.index] = work.numbers[outer.index]
        else:
            inner.maps[parameter.index] = work.maps[outer.index]
    for place, parameter in loop.carried.items():
        known = carried[place]
        if known.scalar:
            inner.numbers[parameter.index] = _number(known.array)
        else:
            inner.maps[parameter.index] = known.array
    inner.levelwise()
    changed = ir.Name(f"changed{node.index}", LOGIC)
    to.body.append(ir.declare(changed, 0))
    _hand_on(inner, loop, carried, changed)
    if loop.again is not None:
        return _flag(inner, loop.again)
    return changed


def _number(array: Array) -> Quantity:
    fraction = 0 if array.format is None else array.format.fraction
    return Quantity(ir.Name(array.name, array.bounds), fraction)


def _hand_on(inner: "Lowering", loop: Loop, carried: list[Carried], changed: ir.Name) -> None:
    """Write the values of the next iteration; all are read before any is written."""
    to = inner.to
    maps = [
        (carried_map, n)
        for carried_map, n in zip(carried, loop.results, strict=True)
        if not carried_map.scalar
    ]
    numbers = [
        (number, n) for number, n in zip(carried, loop.results, strict=True) if number.scalar
    ]
    known, last = dict(inner.numbers), list[ir.Statement]()
    for number, result in numbers:
        old = ir.Name(number.array.name, number.array.bounds)
        new = Quantity(to.stored(inner.numbers[result.index], number.array), 0)
        value = to.let(f"new_{old.text}", new).value
        moved = opposite(call("equal", value, old))
        last += [ir.Assign(changed, call("or", changed, moved)), ir.Assign(old, value)]
    with to.within() as body:
        values = [(target.array, inner.operand(result)) for target, result in maps]
        news = [
            (array, to.let(f"new_{array.name}", Quantity(to.stored(quantity, array), 0)).value)
            for array, quantity in values
        ]
        for array, value in news:
            moved = opposite(call("equal", value, to.item(array).value))
            to.body += [ir.Accumulate(changed, "maximum", moved), to.store_to(array, value)]
    inner.numbers = known
    to.loop(body)
    to.body += last


def _picked(
    work: "Lowering", node: Node, carried: list[Carried], running: ir.Name, rounds: ir.Name
) -> None:
    to = work.to
    for user, pick in picks_of(node, work.schedule.nodes):
        if pick.what == "carried":
            value = carried[pick.layer]
            if value.scalar:
                work.numbers[user.index] = _number(value.array)
            else:
                work.maps[user.index] = value.array
        elif pick.what == "finished":
            work.numbers[user.index] = Quantity(opposite(running))
        else:
            count: ir.Expression = rounds if to.integer else call("to_real", rounds)
            work.numbers[user.index] = Quantity(count)


@dataclass(slots=True, eq=False)
class Level:
    """The operations of one level.

    Attributes
    ----------
    numbers : list of Node
    stages : list of Node
        Transients and loops of the program.
    cells : list of Node
        Local operations and read-outs of maps.
    """

    numbers: list[Node] = field(default_factory=list[Node])
    stages: list[Node] = field(default_factory=list[Node])
    cells: list[Node] = field(default_factory=list[Node])


@dataclass(frozen=True, slots=True, eq=False)
class Levels:
    """Operations by level.

    Attributes
    ----------
    levels : list of Level
    at : dict of int to int
        The level of each node.
    stored : set of int
        Local operations whose map another place needs.
    last : dict of int to int
        The level at which a map is read for the last time.
    """

    levels: list[Level]
    at: dict[int, int]
    stored: set[int]
    last: dict[int, int]


def is_local(node: Node) -> bool:
    """Return whether a node's map is made cell by cell."""
    return isinstance(node.operation, Apply) and not node.scalar


def levels_of(nodes: Iterable[Node], outputs: Iterable[Node], memories: Iterable[Memory]) -> Levels:
    """Return the levels of nodes that are in an order in which they can run."""
    at: dict[int, int] = {}
    levels: list[Level] = []
    stored = {n.index for n in [*outputs, *(m.store for m in memories)] if is_local(n)}
    last: dict[int, int] = {}
    for node in nodes:
        place = max((_after(node, argument, at) for argument in node.arguments), default=0)
        at[node.index] = place
        while len(levels) <= place:
            levels.append(Level())
        _file(node, levels[place])
        for argument in node.arguments:
            last[argument.index] = max(place, last.get(argument.index, 0))
            apart = isinstance(node.operation, Transient | Loop) or at[argument.index] < place
            if is_local(argument) and apart:
                stored.add(argument.index)
    return Levels(levels, at, stored, last)


def _after(node: Node, argument: Node, at: dict[int, int]) -> int:
    """Return the level from which a node can run, by one argument."""
    known = at.get(argument.index, 0)
    if isinstance(argument.operation, Reduce):
        return known + 1
    staged = isinstance(node.operation, Transient | Loop)
    if staged and is_local(argument):
        return known + 1
    # a number that a template leaves is there before the next level's numbers
    if node.scalar and not isinstance(node.operation, Reduce | Pick) and _staged(argument):
        return known + 1
    return known


def _staged(node: Node) -> bool:
    return isinstance(node.operation, Pick) and node.scalar


def _file(node: Node, level: Level) -> None:
    operation = node.operation
    if isinstance(operation, Transient | Loop):
        level.stages.append(node)
    elif isinstance(operation, Reduce) or is_local(node):
        level.cells.append(node)
    elif node.scalar and not isinstance(operation, Parameter | Pick):  # a stage leaves its picks
        level.numbers.append(node)


FOLDS = {
    "sum": "+",
    "largest": "maximum",
    "smallest": "minimum",
    "any": "maximum",
    "all": "minimum",
}
HUGE = 3.0e38


def lower(
    name: str, schedule: Schedule, solvers: Mapping[int, Solver], formats: Formats
) -> IntegerProgram:
    """Return the program of a schedule.

    Parameters
    ----------
    name : str
    schedule : Schedule
    solvers : mapping of int to Solver
        How each transient runs, by the index of its node.
    formats : Sizes or NoFormats
        Whole numbers, or reals.

    Raises
    ------
    NotSupportedError
        If something in it has no form in whole numbers; the sentence names it.
    """
    arithmetic = Fixed(formats.precision.weight) if isinstance(formats, Sizes) else Reals()
    builder = Builder(schedule.shape, arithmetic, formats)
    memories = schedule.memories.values()
    levels = levels_of(schedule.nodes, schedule.outputs.values(), memories)
    work = Lowering(builder, schedule, solvers, levels, going_on(schedule))
    watched = may_not_finish(schedule.nodes)
    if watched:
        builder.body.append(ir.declare(MISSED, 0))
    work.levelwise()
    work.ends()
    if watched:
        words = "whether a loop came to its limit, so that the answers are none"
        answer = builder.array(UNFINISHED, "output", 0, None, words, logic=True)
        builder.body.append(ir.Assign(ir.Name(answer.name, answer.bounds), MISSED))
    return IntegerProgram(
        name,
        schedule.shape,
        builder.arrays,
        tuple(builder.body),
        dict(work.outputs),
        builder.fractions,
    )


def _states_of(node: Node) -> Sequence[Node]:
    """Return the arguments whose states a node hands on."""
    operation = node.operation
    if isinstance(operation, Transient):
        given = operation.by_role(node.arguments)
        starts = given["input"] if operation.template.initial == "input" else ()
        return given["state"] or starts
    if isinstance(operation, Apply):
        chosen = operation.function.name == "select"
        return node.arguments[1:] if chosen else node.arguments
    return node.arguments if isinstance(operation, Pick) else ()


def going_on(schedule: Schedule) -> set[int]:
    """Return the nodes by which the state of a memory comes back to it, by their indices.

    What is rounded on this way is rounded in every frame.
    """
    result = set[int]()
    for memory in schedule.memories.values():
        after = {memory.read.index}
        for node in schedule.nodes:  # arguments come first
            if not node.logic and any(given.index in after for given in _states_of(node)):
                after.add(node.index)
        waiting, seen = [memory.store], set[int]()
        while waiting:
            node = waiting.pop()
            if node.index in after and node.index not in seen:
                seen.add(node.index)
                waiting += _states_of(node)
        result |= seen
    return result


@dataclass(slots=True, eq=False)
class Lowering:
    """The work on one schedule.

    Attributes
    ----------
    to : Builder
    schedule : Schedule
    solvers : mapping of int to Solver
    levels : Levels
    going_on : set of int
        Nodes by which states go from a memory to a memory.
    numbers : dict of int to Quantity
        Numbers and values within the loop that is written, by the index of their nodes.
    maps : dict of int to Array
        Maps that are stored.
    outputs : dict of str to str
    """

    to: Builder
    schedule: Schedule
    solvers: Mapping[int, Solver]
    levels: Levels
    going_on: set[int] = field(default_factory=set[int])
    numbers: dict[int, Quantity] = field(default_factory=dict[int, Quantity])
    maps: dict[int, Array] = field(default_factory=dict[int, Array])
    outputs: dict[str, str] = field(default_factory=dict[str, str])
    _inverses: dict[int, Quantity] = field(default_factory=dict[int, Quantity])
    _direct: set[int] = field(default_factory=set[int])
    _held: dict[int, Quantity] = field(default_factory=dict[int, Quantity])

    def levelwise(self) -> None:
        """Write all that runs, level by level."""
        self.sources()
        for number in range(len(self.levels.levels)):
            self.level(number)

    def body_of(self, schedule: Schedule, results: list[Node]) -> "Lowering":
        """Return the work on a loop's body."""
        levels = levels_of(schedule.nodes, results, ())
        return Lowering(self.to, schedule, self.solvers, levels)

    def sources(self) -> None:
        """Write arrays of inputs, memories and constants."""
        names = array_names("in", self.schedule.channels)
        for node in self.schedule.nodes:
            operation = node.operation
            if node.maps > 1:
                raise NotSupportedError(
                    f"{operation} is a stack of {node.maps} maps, which cannot be exported: leave "
                    "out the outputs that need it."
                )
            if isinstance(operation, Input):
                channel, name = operation.channel, names[operation.channel]
                form = self.to.formats.stored(name)
                self.maps[node.index] = self.to.array(
                    name, "input", self.to.cells, form, f"channel {channel}"
                )
            elif isinstance(operation, ConstantMap):
                table, _ = self.to.table(f"k{node.index}", operation.values, "constant map")
                self.maps[node.index] = table
            elif isinstance(operation, FirstFrame):
                self.numbers[node.index] = Quantity(ir.Name("first", (0, 1)))
            elif isinstance(operation, Constant):
                self.numbers[node.index] = constant(operation.value)
        for number, memory in self.schedule.memories.items():
            self._memory(number, memory.read, memory.store)

    def _memory(self, number: int, read: Node, store: Node) -> None:
        name = f"m{number}"
        length = 0 if read.scalar else self.to.cells
        formats = self.to.formats
        form = formats.register(name) if read.scalar else formats.kept(name)
        array = self.to.array(name, "state", length, form, str(read.operation), logic=read.logic)
        if read.scalar:
            value = self.to.loaded(array, ir.Name(name, array.held))
            self.numbers[read.index] = self.to.let(f"n{read.index}", value)
            return
        self.maps[read.index] = array
        place = self.levels.at.get(store.index, -1)
        # where nothing reads the old value later, the new one takes its place at once
        free = is_local(store) and store.index not in self.maps and not self._ends(read)
        if free and self.levels.last.get(read.index, 0) <= place:
            self.maps[store.index] = array
            self._direct.add(number)

    def _ends(self, node: Node) -> bool:
        """Return whether a value is read after all operations: by an output or a memory."""
        memories = self.schedule.memories.values()
        ends = [*self.schedule.outputs.values(), *(memory.store for memory in memories)]
        return any(end is node for end in ends)

    def level(self, number: int) -> None:
        """Write the operations of a level."""
        level = self.levels.levels[number]
        for node in level.numbers:
            self._number(node)
        for node in level.stages:
            self._stage(node)
        self._cells(level)

    def _number(self, node: Node) -> None:
        if node.index in self.numbers:
            return
        operation = node.operation
        if not isinstance(operation, Apply):
            raise NotSupportedError(f"{operation} cannot be exported as one number.")
        given = [self.operand(argument) for argument in node.arguments]
        self.numbers[node.index] = self._named(node, operation, given)

    def _named(self, node: Node, operation: Apply, given: list[Quantity]) -> Quantity:
        name = f"n{node.index}"
        form = self.to.formats.register(name)
        result = applied(
            self.to.arithmetic,
            operation.function.name,
            given,
            FINE if form is None else form.fraction,
        )
        if form is not None and not node.logic:
            assert isinstance(self.to.arithmetic, Fixed)
            result = self.to.arithmetic.fit(result, form)
        return self.to.let(name, result)

    def operand(self, node: Node) -> Quantity:
        """Return the value of a node where statements go now: of a cell within a loop."""
        if node.index in self.numbers:
            return self.numbers[node.index]
        item = self.to.item(self.maps[node.index])
        self.numbers[node.index] = self.to.let(f"a{node.index}", item)
        return self.numbers[node.index]

    def _stage(self, node: Node) -> None:
        operation = node.operation
        if isinstance(operation, Loop):
            lower_loop(self, node)
            return
        assert isinstance(operation, Transient)
        given = {
            role: [self._given(argument) for argument in some]
            for role, some in operation.by_role(node.arguments).items()
        }
        solver = self.solvers[node.index]
        picks = picks_of(node, self.schedule.nodes)
        remembered = node.index in self.going_on
        maps, figures = lower_transient(self.to, node, solver, given, picks, remembered=remembered)
        self.maps |= maps
        self.numbers |= figures

    def _given(self, node: Node) -> Array | Quantity:
        return self.numbers[node.index] if node.scalar else self.maps[node.index]

    def _cells(self, level: Level) -> None:
        """Write the loop over cells of a level; divisors of maps are inverted before."""
        if not level.cells:
            return
        for node in level.cells:
            self._invert(node)
        known, folds = dict(self.numbers), list[tuple[Node, Quantity]]()
        with self.to.within() as body:
            for source in (argument for node in level.cells for argument in node.arguments):
                # before the loop's own values take their places
                if isinstance(source.operation, Read) and not source.scalar:
                    self.operand(source)
            for node in level.cells:
                if isinstance(node.operation, Reduce):
                    folds.append((node, self._folded(node)))
                else:
                    self._cell(node)
        self.numbers = known
        for node, total in folds:
            assert isinstance(total.value, ir.Name)
            self.to.body.append(ir.declare(total.value, self._start(node, total)))
        self.to.loop(body)
        for node, total in folds:
            name, form = f"n{node.index}", self.to.formats.register(f"n{node.index}")
            if form is not None and not node.logic:
                assert isinstance(self.to.arithmetic, Fixed)
                total = self.to.arithmetic.fit(total, form)
            self.numbers[node.index] = self.to.let(name, total)

    def _invert(self, node: Node) -> None:
        divisor = _divisor(node)
        if divisor is None or divisor.index in self._inverses:
            return
        name = f"r{divisor.index}"
        form = self.to.formats.register(name)
        inverse = applied(
            self.to.arithmetic,
            "divide",
            [constant(1.0), self.numbers[divisor.index]],
            FINE if form is None else form.fraction,
        )
        if form is not None:
            assert isinstance(self.to.arithmetic, Fixed)
            inverse = self.to.arithmetic.fit(inverse, form)
        self._inverses[divisor.index] = self.to.let(name, inverse)

    def _cell(self, node: Node) -> None:
        operation = node.operation
        assert isinstance(operation, Apply)
        given = [self.operand(argument) for argument in node.arguments]
        divisor = _divisor(node)
        if divisor is not None:
            operation = Apply(MULTIPLY)
            given[1] = self._inverses[divisor.index]
        self.numbers[node.index] = self._named(node, operation, given)
        if node.index in self.levels.stored:
            if node.index not in self.maps:
                name, formats = f"t{node.index}", self.to.formats
                form = formats.kept(name) if self._starts(node) else formats.stored(name)
                description = str(node.operation)
                self.maps[node.index] = self.to.array(
                    name, "work", self.to.cells, form, description, logic=node.logic
                )
            array = self.maps[node.index]
            held = self.to.stored(self.numbers[node.index], array)
            fraction = 0 if array.format is None else array.format.fraction
            if array.format is not None and not node.logic:
                self._held[node.index] = self.to.let(f"h{node.index}", Quantity(held, fraction))
                held = self._held[node.index].value
            self.to.body.append(self.to.store_to(array, held))

    def _starts(self, node: Node) -> bool:
        """Return whether a state that goes on from a memory starts from a node."""
        return node.index in self.going_on and any(
            transient.index in self.going_on and node in _states_of(transient)
            for transient in self.schedule.transients
        )

    def _folded(self, node: Node) -> Quantity:
        """Write the fold of a read-out; return its variable."""
        operation = node.operation
        assert isinstance(operation, Reduce)
        argument, how = node.arguments[0], FOLDS[operation.function.name]
        quantity = self.operand(argument)
        if how != "+":
            # the largest number is one of those that another loop finds in the map
            quantity = self._held.get(argument.index, quantity)
        if quantity.exact is not None and isinstance(self.to.arithmetic, Fixed):
            quantity = self.to.arithmetic.settled(quantity)
        value = quantity.value
        if not self.to.integer and not node.logic and value.bounds is not None:
            value = applied(Reals(), "add", [quantity, constant(0.0)], 0).value
        bounds = value.bounds
        if bounds is not None and how == "+":
            bounds = min(0, bounds[0] * self.to.cells), max(0, bounds[1] * self.to.cells)
        folded = ir.Name(f"f{node.index}", bounds)
        self.to.body.append(ir.Accumulate(folded, how, value))
        return Quantity(folded, quantity.fraction)

    def _start(self, node: Node, total: Quantity) -> ir.Integer | ir.Number:
        operation = node.operation
        assert isinstance(operation, Reduce)
        how, bounds = FOLDS[operation.function.name], total.value.bounds
        if how == "+":
            return ir.Integer(0) if bounds is not None else ir.Number(0.0)
        if bounds is None:
            return ir.Number(-HUGE if how == "maximum" else HUGE)
        return ir.Integer(bounds[0] if how == "maximum" else bounds[1])

    def ends(self) -> None:
        """Write outputs, and the memories for the next frame."""
        copied = list[tuple[Array, Node]]()
        names = array_names("out", self.schedule.outputs)
        for name, node in self.schedule.outputs.items():
            array = self._output(name, names[name], node)
            self.outputs[name] = array.name
            if node.scalar:
                self._set(array, node)
            else:
                copied.append((array, node))
        for number, memory in self.schedule.memories.items():
            array = self.to.arrays[f"m{number}"]
            if memory.read.scalar:
                self._set(array, memory.store)
            elif number not in self._direct and memory.store is not memory.read:
                copied.append((array, memory.store))
        self._copy(copied)

    def _copy(self, copied: list[tuple[Array, Node]]) -> None:
        known = dict(self.numbers)
        with self.to.within() as body:
            # all are read before any is written: memories may hold each other
            values = [self.operand(node) for _, node in copied]
            for (array, _), value in zip(copied, values, strict=True):
                self.to.store(array, value)
        self.numbers = known
        self.to.loop(body)

    def _set(self, array: Array, node: Node) -> None:
        value = self.to.stored(self.numbers[node.index], array)
        self.to.body.append(ir.Assign(ir.Name(array.name, array.bounds), value))

    def _output(self, name: str, array: str, node: Node) -> Array:
        form, length = self.to.formats, 0 if node.scalar else self.to.cells
        wide = form.register(array) if node.scalar else form.stored(array)
        return self.to.array(array, "output", length, wide, name, logic=node.logic)


def _divisor(node: Node) -> Node | None:
    """Return the number that divides a map, where a node does that."""
    operation = node.operation
    if not isinstance(operation, Apply) or operation.function.name != "divide" or node.scalar:
        return None
    divisor = node.arguments[1]
    return divisor if divisor.scalar and not isinstance(divisor.operation, Constant) else None
