"""A program as LLVM assembly: its operations on vectors of rows, within loops over rows, steps and parts of a step.

The function reads one table of 8-byte words::

    outer, inner, steps, parts                  lengths of both batch axes, steps, and parts of a step
    memory, filled                              where what is worked out of the constants stays, and whether it is there
    pointer, outer, inner, step, part           of each array: where it begins, and its strides in bytes

The numbers of a row lie side by side in every array. A vector that reaches beyond the last row repeats that one.
Without a memory (0) the constants are read at every call.

A second function is a callback of MuJoCo's: it runs the table that a global variable points to, and moves all its
arrays on by a step, so that each call finds the next one.
"""

from collections.abc import Iterator, Sequence
from contextlib import contextmanager

from auv_torchrl.physics.kernel.lines import Lines
from auv_torchrl.physics.kernel.program import Layout, Program, offsets

# of an AVX2 register, by bits; 8 doubles were slower without AVX-512, and compile three times as long
LANES = {64: 4, 32: 8}
MEMORY, FILLED = 4, 5  # words of the table
COUNTS = 6  # words of the table before the first array
WORDS = 5  # of each array
STEP = 3  # the one of an array that tells how far its steps are apart
ENTRY, CALLBACK = "run_rows", "run_rows_of_table"  # functions
TABLE, KEPT = "table_of_rows", "kept_of_rows"  # variables: of the callback, and the numbers of a row in the memory

Pointers = dict[str, list[str]]  # of each array, by name: one pointer for each lane, or the words of the table

_BINARY = {"add": "fadd contract", "sub": "fsub contract", "mul": "fmul contract"}  # may fuse product and sum
_FUNCTIONS = {
    "abs": "fabs", "sqrt": "sqrt", "round": "rint",
    **{name: name for name in ("exp", "sin", "cos", "tanh", "atan2")},
}  # fmt: skip


def array_names(layout: Layout) -> list[str]:
    """Names of the arrays of the table, in order; all constants are one array."""
    final = [f"final {name}" for name in layout.carried]
    return ["constants", *layout.carried, *layout.given, *layout.written, *final]


def assembly(program: Program, bits: int = 64) -> str:
    """The text of a module that holds the function, which computes a program in numbers of 64 or 32 bits."""
    return _Writer(program, bits).module()


class _Writer(Lines):
    def __init__(self, program: Program, bits: int):
        super().__init__(LANES[bits], bits)
        self._program, self._layout = program, program.layout
        self._suffix = f"v{self.lanes}f{bits}"

    def module(self) -> str:
        declared = [
            f"declare {self.vector} @llvm.{name}.{self._suffix}({', '.join([self.vector] * (1 + (name == 'atan2')))})"
            for name in _FUNCTIONS.values()
        ]
        self._function()
        function = [f"define void @{ENTRY}(ptr %table) {{", *self.text, "}"]
        self.text.clear()
        self._callback()
        callback = [f"define void @{CALLBACK}(ptr %model, ptr %data) {{", *self.text, "}"]
        variables = [f"@{TABLE} = global ptr null", f"@{KEPT} = constant i64 {len(self._program.kept)}"]
        return "\n".join([*declared, *variables, *function, *callback, ""])

    def _callback(self) -> None:
        self.label("entry")
        self.put(f"%table = load ptr, ptr @{TABLE}")
        self.put(f"call void @{ENTRY}(ptr %table)")
        for place in range(len(array_names(self._layout))):
            first = COUNTS + WORDS * place
            later = self.let(f"add i64 {self.word('i64', first)}, {self.word('i64', first + STEP)}")
            self.put(f"store i64 {later}, ptr {self.let(f'getelementptr i64, ptr %table, i64 {first}')}")
        self.put("ret void")

    def _function(self) -> None:
        names = array_names(self._layout)
        self.label("entry")
        counts = [self.word("i64", word) for word in range(MEMORY)]
        table = {
            name: [self.word("i64" if word else "ptr", COUNTS + WORDS * place + word) for word in range(WORDS)]
            for place, name in enumerate(names)
        }
        constants = self.buffer(sum(self._layout.constants.values()))
        own = self.buffer(len(self._program.kept))
        carried = self.buffer(sum(self._layout.carried.values()))
        with self.loop("outer", counts[0]) as outer, self.loop("row", counts[1], self.lanes) as first:
            rows = self.rows(first, counts[1])
            at = {name: self.pointers(words, outer, rows) for name, words in table.items()}
            kept = self._remembered(own, counts[1], outer, first)
            with self._where_new(table["constants"], outer, first):
                self._work_out_constants(at["constants"], constants, kept)
            for name, start in offsets(self._layout.carried).items():
                for k in range(self._layout.carried[name]):
                    self.store(self.gather(at[name], k), carried, start + k)
            with self.loop("step", counts[2]) as step, self.loop("part", counts[3]) as part:
                given = {name: self.moved(at[name], table[name], step=step, part=part) for name in self._layout.given}
                self._part(given, at, table, step, kept, carried)
            for name, start in offsets(self._layout.carried).items():
                for k in range(self._layout.carried[name]):
                    self.scatter(self.load(carried, start + k), at[f"final {name}"], k)
        self.put(f"store i64 1, ptr {self.let(f'getelementptr i64, ptr %table, i64 {FILLED}')}")
        self.put("ret void")

    def _remembered(self, own: str, inner: str, outer: str, first: str) -> str:
        """Where these rows keep what is worked out of their constants: in the memory if there is one."""
        vectors = self.let(f"udiv i64 {self.let(f'add i64 {inner}, {self.lanes - 1}')}, {self.lanes}")
        vector = self.let(
            f"add i64 {self.let(f'mul i64 {outer}, {vectors}')}, {self.let(f'udiv i64 {first}, {self.lanes}')}"
        )
        memory = self.word("ptr", MEMORY)
        place = self.let(f"mul i64 {vector}, {len(self._program.kept)}")
        there = self.let(f"getelementptr {self.vector}, ptr {memory}, i64 {place}")
        return self.let(f"select i1 {self.let(f'icmp ne ptr {memory}, null')}, ptr {there}, ptr {own}")

    def _work_out_constants(self, pointers: Sequence[str], constants: str, kept: str) -> None:
        with self.loop("constant", str(sum(self._layout.constants.values()))) as k:
            self.store(self.gather(pointers, k), constants, k)
        starts = offsets(self._layout.constants)
        values = self._computed(
            self._program.before, lambda name, place: self.load(constants, starts[name] + place), {}
        )
        for slot, place in enumerate(self._program.kept):
            self.store(values[place], kept, slot)

    def _part(self, given: Pointers, at: Pointers, table: Pointers, step: str, kept: str, carried: str) -> None:
        starts = offsets(self._layout.carried)
        slots = {place: slot for slot, place in enumerate(self._program.kept)}

        def read(name: str, place: int) -> str:
            return self.gather(given[name], place) if name in given else self.load(carried, starts[name] + place)

        values = self._computed(self._program.steps, read, slots, kept)
        for name, places in self._program.outputs.items():
            found = [self._value(place, values, slots, kept) for place in places]
            if name in starts:
                for k, vector in enumerate(found):
                    self.store(vector, carried, starts[name] + k)
            if name in self._layout.written:  # parts but the last are written over
                pointers = self.moved(at[name], table[name], step=step)
                for k, vector in enumerate(found):
                    self.scatter(vector, pointers, k)

    def _computed(self, places: Sequence[int], read, slots: dict[int, int], kept: str = "") -> dict[int, str]:
        """The names of what is computed at some places of the program."""
        values: dict[int, str] = {}
        for place in places:
            kind, given = self._program.operations[place]
            if kind == "input":
                values[place] = read(*given)
            else:
                values[place] = self._operation(kind, [self._value(each, values, slots, kept) for each in given])
        return values

    def _value(self, place: int, values: dict[int, str], slots: dict[int, int], kept: str) -> str:
        kind, given = self._program.operations[place]
        if kind == "constant":
            return self.constant(given[0])
        if place not in values:  # the first step to need it reads it; the others find it in a register or there
            values[place] = self.load(kept, slots[place])
        return values[place]

    def _operation(self, kind: str, given: list[str]) -> str:
        vector = self.vector
        if kind in _BINARY:
            return self.let(f"{_BINARY[kind]} {vector} {given[0]}, {given[1]}")
        if kind in _FUNCTIONS:
            read = ", ".join(f"{vector} {each}" for each in given)
            return self.let(f"call {vector} @llvm.{_FUNCTIONS[kind]}.{self._suffix}({read})")
        if kind == "inverse":
            return self.let(f"fdiv {vector} {self.constant(1.0)}, {given[0]}")
        if kind == "neg":
            return self.let(f"fneg {vector} {given[0]}")
        if kind == "less":
            return self.let(f"fcmp olt {vector} {given[0]}, {given[1]}")
        if kind == "where":
            truth = f"<{self.lanes} x i1> {given[0]}"
            return self.let(f"select {truth}, {vector} {given[1]}, {vector} {given[2]}")
        raise ValueError(f"no machine operation for {kind!r}: give it one here and in symbols.py")

    @contextmanager
    def _where_new(self, words: list[str], outer: str, first: str) -> Iterator[None]:
        """Lines that are left out where these rows have the vehicle of the ones before, or the memory has it."""
        by_row, by_outer = (self.let(f"icmp ne i64 {words[word]}, 0") for word in (2, 1))
        begins, starts = (self.let(f"icmp eq i64 {index}, 0") for index in (first, outer))
        either = self.let(f"or i1 {by_outer}, {starts}")
        other = self.let(f"or i1 {by_row}, {self.let(f'and i1 {begins}, {either}')}")
        memory, empty = self.word("i64", MEMORY), self.let(f"icmp eq i64 {self.word('i64', FILLED)}, 0")
        new = self.let(f"select i1 {self.let(f'icmp ne i64 {memory}, 0')}, i1 {empty}, i1 {other}")
        self.put(f"br i1 {new}, label %vehicle, label %known")
        self.label("vehicle")
        yield
        self.put("br label %known")
        self.label("known")
