"""A program as LLVM assembly: its operations on vectors of rows, within loops over rows, steps and parts of a step.

The function reads one table of 8-byte words::

    outer, inner, steps, parts                  lengths of both batch axes, steps, and parts of a step
    pointer, outer, inner, step, part           of each array: where it begins, and its strides in bytes

The numbers of a row lie side by side in every array. A vector that reaches beyond the last row repeats that one.
"""

import struct
from collections.abc import Iterator, Sequence
from contextlib import contextmanager

import numpy as np

from auv_torchrl.physics.kernel.program import Layout, Program, offsets

COUNTS = 4  # words of the table before the first array
WORDS = 5  # of each array
ENTRY = "run_rows"

Pointers = dict[str, list[str]]  # of each array, by name: one pointer for each lane, or the words of the table

_BINARY = {"add": "fadd contract", "sub": "fsub contract", "mul": "fmul contract"}  # may fuse product and sum
_FUNCTIONS = {"abs": "fabs", "sqrt": "sqrt", "exp": "exp"}


def array_names(layout: Layout) -> list[str]:
    """Names of the arrays of the table, in order; all constants are one array."""
    final = [f"final {name}" for name in layout.carried]
    return ["constants", *layout.carried, *layout.given, *layout.written, *final]


def assembly(program: Program, lanes: int, bits: int = 64) -> str:
    """The text of a module that holds the function.

    Args:
        program: what it computes.
        lanes: rows that are computed at once.
        bits: of its numbers, 64 or 32.
    """
    return _Writer(program, lanes, bits).module()


class _Writer:
    def __init__(self, program: Program, lanes: int, bits: int):
        self._program, self._layout = program, program.layout
        self._number, self._bytes = {64: "double", 32: "float"}[bits], bits // 8
        self._lanes, self._vector = lanes, f"<{lanes} x {self._number}>"
        self._suffix = f"v{lanes}f{bits}"
        self._lines: list[str] = []
        self._count = 0

    def module(self) -> str:
        declared = [
            f"declare {self._vector} @llvm.{name}.{self._suffix}({self._vector})" for name in _FUNCTIONS.values()
        ]
        self._function()
        return "\n".join([*declared, f"define void @{ENTRY}(ptr %table) {{", *self._lines, "}", ""])

    def _function(self) -> None:
        names = array_names(self._layout)
        self._label("entry")
        counts = [self._word("i64", word) for word in range(COUNTS)]
        table = {
            name: [self._word("i64" if word else "ptr", COUNTS + WORDS * place + word) for word in range(WORDS)]
            for place, name in enumerate(names)
        }
        constants = self._buffer(sum(self._layout.constants.values()))
        kept = self._buffer(len(self._program.kept))
        carried = self._buffer(sum(self._layout.carried.values()))
        with self._loop("outer", counts[0]) as outer, self._loop("row", counts[1], self._lanes) as first:
            rows = self._rows(first, counts[1])
            at = {name: self._pointers(words, outer, rows) for name, words in table.items()}
            with self._where_new(table["constants"], outer, first):
                self._work_out_constants(at["constants"], constants, kept)
            for name, start in offsets(self._layout.carried).items():
                for k in range(self._layout.carried[name]):
                    self._store(self._gather(at[name], k), carried, start + k)
            with self._loop("step", counts[2]) as step, self._loop("part", counts[3]) as part:
                given = {name: self._moved(at[name], table[name], step=step, part=part) for name in self._layout.given}
                self._part(given, at, table, step, kept, carried)
            for name, start in offsets(self._layout.carried).items():
                for k in range(self._layout.carried[name]):
                    self._scatter(self._load(carried, start + k), at[f"final {name}"], k)
        self._put("ret void")

    def _work_out_constants(self, pointers: Sequence[str], constants: str, kept: str) -> None:
        with self._loop("constant", str(sum(self._layout.constants.values()))) as k:
            self._store(self._gather(pointers, k), constants, k)
        starts = offsets(self._layout.constants)
        values = self._computed(
            self._program.before, lambda name, place: self._load(constants, starts[name] + place), {}
        )
        for slot, place in enumerate(self._program.kept):
            self._store(values[place], kept, slot)

    def _part(self, given: Pointers, at: Pointers, table: Pointers, step: str, kept: str, carried: str) -> None:
        starts = offsets(self._layout.carried)
        slots = {place: slot for slot, place in enumerate(self._program.kept)}

        def read(name: str, place: int) -> str:
            return self._gather(given[name], place) if name in given else self._load(carried, starts[name] + place)

        values = self._computed(self._program.steps, read, slots, kept)
        for name, places in self._program.outputs.items():
            found = [self._value(place, values, slots, kept) for place in places]
            if name in starts:
                for k, vector in enumerate(found):
                    self._store(vector, carried, starts[name] + k)
            if name in self._layout.written:  # parts but the last are written over
                pointers = self._moved(at[name], table[name], step=step)
                for k, vector in enumerate(found):
                    self._scatter(vector, pointers, k)

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
            return self._constant(given[0])
        if place not in values:  # the first step to need it reads it; the others find it in a register or there
            values[place] = self._load(kept, slots[place])
        return values[place]

    def _operation(self, kind: str, given: list[str]) -> str:
        vector = self._vector
        if kind in _BINARY:
            return self._let(f"{_BINARY[kind]} {vector} {given[0]}, {given[1]}")
        if kind in _FUNCTIONS:
            return self._let(f"call {vector} @llvm.{_FUNCTIONS[kind]}.{self._suffix}({vector} {given[0]})")
        if kind == "inverse":
            return self._let(f"fdiv {vector} {self._constant(1.0)}, {given[0]}")
        if kind == "neg":
            return self._let(f"fneg {vector} {given[0]}")
        if kind == "less":
            return self._let(f"fcmp olt {vector} {given[0]}, {given[1]}")
        if kind == "where":
            truth = f"<{self._lanes} x i1> {given[0]}"
            return self._let(f"select {truth}, {vector} {given[1]}, {vector} {given[2]}")
        raise ValueError(f"no machine operation for {kind!r}: give it one here and in symbols.py")

    def _constant(self, value: float) -> str:
        value = value if self._bytes == 8 else float(np.float32(value))  # LLVM takes what the type holds exactly
        bits = struct.unpack(">Q", struct.pack(">d", value))[0]
        return "<" + ", ".join([f"{self._number} 0x{bits:016X}"] * self._lanes) + ">"

    def _rows(self, first: str, inner: str) -> list[str]:
        """The rows of the lanes; those beyond the last are the last."""
        last = self._let(f"sub i64 {inner}, 1")
        rows = []
        for lane in range(self._lanes):
            row = self._let(f"add i64 {first}, {lane}")
            inside = self._let(f"icmp slt i64 {row}, {last}")
            rows.append(self._let(f"select i1 {inside}, i64 {row}, i64 {last}"))
        return rows

    def _pointers(self, words: list[str], outer: str, rows: Sequence[str]) -> list[str]:
        base = self._let(f"getelementptr i8, ptr {words[0]}, i64 {self._let(f'mul i64 {outer}, {words[1]}')}")
        return [
            self._let(f"getelementptr i8, ptr {base}, i64 {self._let(f'mul i64 {row}, {words[2]}')}") for row in rows
        ]

    def _moved(self, pointers: Sequence[str], words: list[str], step: str, part: str = "0") -> list[str]:
        steps, parts = self._let(f"mul i64 {step}, {words[3]}"), self._let(f"mul i64 {part}, {words[4]}")
        by = self._let(f"add i64 {steps}, {parts}")
        return [self._let(f"getelementptr i8, ptr {pointer}, i64 {by}") for pointer in pointers]

    def _gather(self, pointers: Sequence[str], place: int | str) -> str:
        vector = "poison"
        for lane, pointer in enumerate(pointers):
            at = self._let(f"getelementptr {self._number}, ptr {pointer}, i64 {place}")
            number = self._let(f"load {self._number}, ptr {at}, align {self._bytes}")
            vector = self._let(f"insertelement {self._vector} {vector}, {self._number} {number}, i32 {lane}")
        return vector

    def _scatter(self, vector: str, pointers: Sequence[str], place: int) -> None:
        for lane, pointer in enumerate(pointers):
            number = self._let(f"extractelement {self._vector} {vector}, i32 {lane}")
            at = self._let(f"getelementptr {self._number}, ptr {pointer}, i64 {place}")
            self._put(f"store {self._number} {number}, ptr {at}, align {self._bytes}")

    def _buffer(self, numbers: int) -> str:
        return self._let(f"alloca [{max(numbers, 1)} x {self._vector}], align {self._bytes * self._lanes}")

    def _load(self, buffer: str, place: int | str) -> str:
        at = self._let(f"getelementptr {self._vector}, ptr {buffer}, i64 {place}")
        return self._let(f"load {self._vector}, ptr {at}")

    def _store(self, vector: str, buffer: str, place: int | str) -> None:
        at = self._let(f"getelementptr {self._vector}, ptr {buffer}, i64 {place}")
        self._put(f"store {self._vector} {vector}, ptr {at}")

    def _word(self, kind: str, word: int) -> str:
        at = self._let(f"getelementptr i64, ptr %table, i64 {word}")
        return self._let(f"load {kind}, ptr {at}")

    @contextmanager
    def _loop(self, name: str, count: str, stride: int = 1) -> Iterator[str]:
        """Lines that are run for 0, ``stride`` ... below ``count``, at least once."""
        self._put(f"br label %{name}.enter")
        self._label(f"{name}.enter")
        self._put(f"br label %{name}")
        self._label(name)
        self._put(f"%{name}.index = phi i64 [0, %{name}.enter], [%{name}.later, %{name}.next]")
        yield f"%{name}.index"
        self._put(f"br label %{name}.next")
        self._label(f"{name}.next")
        self._put(f"%{name}.later = add i64 %{name}.index, {stride}")
        more = self._let(f"icmp slt i64 %{name}.later, {count}")
        self._put(f"br i1 {more}, label %{name}, label %{name}.exit")
        self._label(f"{name}.exit")

    @contextmanager
    def _where_new(self, words: list[str], outer: str, first: str) -> Iterator[None]:
        """Lines that are left out where these rows have the vehicle of the ones before."""
        by_row, by_outer = (self._let(f"icmp ne i64 {words[word]}, 0") for word in (2, 1))
        begins, starts = (self._let(f"icmp eq i64 {index}, 0") for index in (first, outer))
        either = self._let(f"or i1 {by_outer}, {starts}")
        new = self._let(f"or i1 {by_row}, {self._let(f'and i1 {begins}, {either}')}")
        self._put(f"br i1 {new}, label %vehicle, label %known")
        self._label("vehicle")
        yield
        self._put("br label %known")
        self._label("known")

    def _let(self, text: str) -> str:
        self._count += 1
        self._put(f"%v{self._count} = {text}")
        return f"%v{self._count}"

    def _put(self, text: str) -> None:
        self._lines.append("  " + text)

    def _label(self, name: str) -> None:
        self._lines.append(f"{name}:")
