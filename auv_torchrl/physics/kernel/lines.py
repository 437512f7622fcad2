"""Lines of LLVM assembly: numbers of rows as vectors, arrays by pointers, loops."""

import struct
from collections.abc import Iterator, Sequence
from contextlib import contextmanager

import numpy as np


class Lines:
    """Writes one line after the other; what is computed gets a name of its own."""

    def __init__(self, lanes: int, bits: int):
        self.number, self.bytes = {64: "double", 32: "float"}[bits], bits // 8
        self.lanes, self.vector = lanes, f"<{lanes} x {self.number}>"
        self.text: list[str] = []
        self._count = 0

    def constant(self, value: float) -> str:
        """A vector of one number."""
        value = value if self.bytes == 8 else float(np.float32(value))  # LLVM takes what the type holds exactly
        bits = struct.unpack(">Q", struct.pack(">d", value))[0]
        return "<" + ", ".join([f"{self.number} 0x{bits:016X}"] * self.lanes) + ">"

    def rows(self, first: str, inner: str) -> list[str]:
        """The rows of the lanes; those beyond the last are the last."""
        last = self.let(f"sub i64 {inner}, 1")
        rows = []
        for lane in range(self.lanes):
            row = self.let(f"add i64 {first}, {lane}")
            inside = self.let(f"icmp slt i64 {row}, {last}")
            rows.append(self.let(f"select i1 {inside}, i64 {row}, i64 {last}"))
        return rows

    def pointers(self, words: list[str], outer: str, rows: Sequence[str]) -> list[str]:
        """Where the numbers of some rows of an array begin, its words given."""
        base = self.let(f"getelementptr i8, ptr {words[0]}, i64 {self.let(f'mul i64 {outer}, {words[1]}')}")
        return [self.let(f"getelementptr i8, ptr {base}, i64 {self.let(f'mul i64 {row}, {words[2]}')}") for row in rows]

    def moved(self, pointers: Sequence[str], words: list[str], step: str, part: str = "0") -> list[str]:
        """Pointers to a step and a part of it."""
        steps, parts = self.let(f"mul i64 {step}, {words[3]}"), self.let(f"mul i64 {part}, {words[4]}")
        by = self.let(f"add i64 {steps}, {parts}")
        return [self.let(f"getelementptr i8, ptr {pointer}, i64 {by}") for pointer in pointers]

    def gather(self, pointers: Sequence[str], place: int | str) -> str:
        """A vector of the number at a place of each row."""
        vector = "poison"
        for lane, pointer in enumerate(pointers):
            at = self.let(f"getelementptr {self.number}, ptr {pointer}, i64 {place}")
            number = self.let(f"load {self.number}, ptr {at}, align {self.bytes}")
            vector = self.let(f"insertelement {self.vector} {vector}, {self.number} {number}, i32 {lane}")
        return vector

    def scatter(self, vector: str, pointers: Sequence[str], place: int) -> None:
        """Put a vector into a place of each row."""
        for lane, pointer in enumerate(pointers):
            number = self.let(f"extractelement {self.vector} {vector}, i32 {lane}")
            at = self.let(f"getelementptr {self.number}, ptr {pointer}, i64 {place}")
            self.put(f"store {self.number} {number}, ptr {at}, align {self.bytes}")

    def buffer(self, numbers: int) -> str:
        """Room for vectors."""
        return self.let(f"alloca [{max(numbers, 1)} x {self.vector}], align {self.bytes * self.lanes}")

    def load(self, buffer: str, place: int | str) -> str:
        """A vector of a buffer."""
        at = self.let(f"getelementptr {self.vector}, ptr {buffer}, i64 {place}")
        return self.let(f"load {self.vector}, ptr {at}")

    def store(self, vector: str, buffer: str, place: int | str) -> None:
        """Put a vector into a buffer."""
        at = self.let(f"getelementptr {self.vector}, ptr {buffer}, i64 {place}")
        self.put(f"store {self.vector} {vector}, ptr {at}")

    def word(self, kind: str, word: int) -> str:
        """A word of the table."""
        at = self.let(f"getelementptr i64, ptr %table, i64 {word}")
        return self.let(f"load {kind}, ptr {at}")

    @contextmanager
    def loop(self, name: str, count: str, stride: int = 1) -> Iterator[str]:
        """Lines that are run for 0, ``stride`` ... below ``count``, at least once."""
        self.put(f"br label %{name}.enter")
        self.label(f"{name}.enter")
        self.put(f"br label %{name}")
        self.label(name)
        self.put(f"%{name}.index = phi i64 [0, %{name}.enter], [%{name}.later, %{name}.next]")
        yield f"%{name}.index"
        self.put(f"br label %{name}.next")
        self.label(f"{name}.next")
        self.put(f"%{name}.later = add i64 %{name}.index, {stride}")
        more = self.let(f"icmp slt i64 %{name}.later, {count}")
        self.put(f"br i1 {more}, label %{name}, label %{name}.exit")
        self.label(f"{name}.exit")

    def let(self, text: str) -> str:
        """The name of what an operation gives."""
        self._count += 1
        self.put(f"%v{self._count} = {text}")
        return f"%v{self._count}"

    def put(self, text: str) -> None:
        """One line."""
        self.text.append("  " + text)

    def label(self, name: str) -> None:
        """Where a jump ends."""
        self.text.append(f"{name}:")
