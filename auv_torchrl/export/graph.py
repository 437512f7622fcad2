"""ONNX graphs that are written as arithmetic: an array library of which every operation becomes a node.

Formulas on the array API, as those of :mod:`auv_torchrl.physics.thrusters`, run on a :class:`Value` as they are. What
is not an operation of ONNX (solving equations, Newton's method) is made of those that are.
"""

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from numpy.lib.mixins import NDArrayOperatorsMixin

from auv_torchrl.extras import library

OPSET = 18  # onnxruntime from 1.14 reads it
IR_VERSION = 9  # likewise; onnx itself would write its newest, which older runtimes refuse
BATCH = "N"  # of the first axis of every input and output
# numpy's functions of elements, and the operations of ONNX that they are
_NODES = {
    "absolute": "Abs", "add": "Add", "bitwise_and": "And", "bitwise_or": "Or", "divide": "Div", "equal": "Equal",
    "greater": "Greater", "less": "Less", "less_equal": "LessOrEqual", "matmul": "MatMul", "maximum": "Max",
    "minimum": "Min", "multiply": "Mul", "negative": "Neg", "power": "Pow", "sign": "Sign", "subtract": "Sub",
    "tanh": "Tanh",
}  # fmt: skip
_TRUTHS = {"bitwise_and", "bitwise_or", "equal", "greater", "less", "less_equal"}
Array = Any


class Graph:
    """Nodes in the order in which they are computed.

    Args:
        name: of the graph.
        dtype: of its numbers, "float32" or "float64".
        outer: the graph in whose loop this one is.
    """

    def __init__(self, name: str, dtype: str = "float32", outer: "Graph | None" = None):
        self.name, self.dtype = name, np.dtype(dtype)
        self.onnx = outer.onnx if outer else library("onnx", "an export needs", "export")
        self._outer, self.depth, self._made = outer, outer.depth + 1 if outer else 0, 0
        self._nodes: list[Any] = []
        self._constants: list[Any] = []
        self._inputs: list[Any] = []
        self._outputs: list[Any] = []

    def fresh(self) -> str:
        """A name that no other value of the file has."""
        root: Graph = self
        while root._outer is not None:
            root = root._outer
        root._made += 1
        return f"v{root._made}"

    def input(self, name: str, *shape: int | str, dtype: Any = None) -> "Value":
        """An input of numbers, by default of the graph's dtype, the batch before ``shape`` unless that is empty."""
        return self._declare(self._inputs, Value(self, name, dtype or self.dtype), shape)

    def parameter(self, name: str, *shape: int) -> "Value":
        """An input that has no batch: the same for all rows."""
        value = Value(self, name, self.dtype)
        self._inputs.append(self._info(value, list(shape)))
        return value

    def output(self, name: str, value: "Value", *shape: int | str) -> None:
        """Name a result."""
        self._nodes.append(self.onnx.helper.make_node("Identity", [value.name], [name]))
        self._declare(self._outputs, Value(self, name, value.dtype), shape)

    def _declare(self, where: list[Any], value: "Value", shape: Sequence[int | str]) -> "Value":
        where.append(self._info(value, [BATCH, *shape]))
        return value

    def _info(self, value: "Value", shape: list[int | str] | None) -> Any:
        kind = self.onnx.helper.np_dtype_to_tensor_dtype(value.dtype)
        return self.onnx.helper.make_tensor_value_info(value.name, kind, shape)

    def constant(self, array: Array, dtype: Any = None) -> "Value":
        """A constant, by default of the graph's dtype."""
        value = Value(self, self.fresh(), np.dtype(dtype or self.dtype))
        content = np.array(array, value.dtype)
        self._constants.append(self.onnx.numpy_helper.from_array(content, value.name))
        return value

    def op(self, kind: str, *inputs: "Value | Array", dtype: Any = None, outputs: int = 1, **attributes: Any) -> Any:
        """The value, or the values, of a node; ``dtype`` is that of the first one, by default of the first input."""
        given = [value if isinstance(value, Value) else self.constant(value) for value in inputs]
        made = [Value(self, self.fresh(), np.dtype(dtype or given[0].dtype)) for _ in range(outputs)]
        names = [value.name for value in given], [value.name for value in made]
        self._nodes.append(self.onnx.helper.make_node(kind, *names, **attributes))
        return made[0] if outputs == 1 else made

    def loop(self, most: int, start: "Value", step: Callable[["Graph", "Value"], tuple["Value", "Value"]]) -> "Value":
        """``start``, followed by ``step`` until that says not to go on, at most so many times.

        Args:
            most: rounds.
            start: the first value.
            step: from a graph and the value, to the next value and whether to go on, () bool.
        """
        inner = Graph(f"{self.name}_round", self.dtype.name, self)
        number, going = (Value(inner, self.fresh(), np.dtype(kind)) for kind in ("int64", "bool"))
        before = Value(inner, self.fresh(), start.dtype)
        inner._inputs = [inner._info(number, []), inner._info(going, []), inner._info(before, None)]
        after, on = step(inner, before)
        inner._outputs = [inner._info(on, []), inner._info(after, None)]
        end = Value(self, self.fresh(), start.dtype)
        names = [self.constant(most, np.int64).name, self.constant(True, np.bool_).name, start.name]
        self._nodes.append(self.onnx.helper.make_node("Loop", names, [end.name], body=inner._graph()))
        return end

    def _graph(self) -> Any:
        return self.onnx.helper.make_graph(self._nodes, self.name, self._inputs, self._outputs, self._constants)

    def bytes(self) -> bytes:
        """The file, checked by onnx's own rules."""
        opset = self.onnx.helper.make_opsetid("", OPSET)
        model = self.onnx.helper.make_model(
            self._graph(), opset_imports=[opset], ir_version=IR_VERSION, producer_name="auv_torchrl"
        )
        self.onnx.checker.check_model(model, full_check=True)
        return model.SerializeToString()


class Value(NDArrayOperatorsMixin):
    """A number or array of a graph; numpy's operators and functions of elements make nodes of it."""

    def __init__(self, graph: Graph, name: str, dtype: Any):
        self.graph, self.name, self.dtype = graph, name, np.dtype(dtype)

    def __array_namespace__(self, api_version: str | None = None) -> "type[Namespace]":
        return Namespace

    def __array_ufunc__(self, ufunc: np.ufunc, method: str, *inputs: Any, **options: Any) -> "Value":
        if method != "__call__" or options or ufunc.__name__ not in _NODES:
            raise NotImplementedError(f"an ONNX graph has no {ufunc.__name__} here: add it to {__name__}")
        values = [value for value in inputs if isinstance(value, Value)]
        graph, dtype = _innermost([value.graph for value in values]), values[0].dtype
        given = [value if isinstance(value, Value) else graph.constant(value, dtype) for value in inputs]
        truth = ufunc.__name__ in _TRUTHS
        return graph.op(_NODES[ufunc.__name__], *given, dtype=np.bool_ if truth else dtype)

    def astype(self, dtype: Any) -> "Value":
        """The same as another kind of number."""
        kind = self.graph.onnx.helper.np_dtype_to_tensor_dtype(np.dtype(dtype))
        return self.graph.op("Cast", self, dtype=dtype, to=kind)

    def turned(self) -> "Value":
        """The transpose of a matrix."""
        return self.graph.op("Transpose", self, perm=[1, 0])

    def unsqueeze(self, *axes: int) -> "Value":
        """With axes of length 1."""
        return self.graph.op("Unsqueeze", self, self.graph.constant(axes, np.int64))

    def squeeze(self, *axes: int) -> "Value":
        """Without axes of length 1."""
        return self.graph.op("Squeeze", self, self.graph.constant(axes, np.int64))

    def columns(self, first: int, last: int) -> "Value":
        """Entries ``first`` to ``last`` (left out) of the last axis."""
        ends = (self.graph.constant([number], np.int64) for number in (first, last, -1))
        return self.graph.op("Slice", self, *ends)

    def sum(self, axis: int = -1, keepdims: bool = False) -> Any:
        """Along an axis."""
        return self._reduced("ReduceSum", axis, keepdims)

    def max(self, axis: int = -1, keepdims: bool = False) -> Any:
        """Along an axis."""
        return self._reduced("ReduceMax", axis, keepdims)

    def all(self) -> "Value":
        """Whether all are true, ()."""
        return self.graph.op("ReduceMin", self.astype(np.int64), keepdims=0).astype(np.bool_)

    def _reduced(self, kind: str, axis: int, keepdims: bool) -> "Value":
        return self.graph.op(kind, self, self.graph.constant([axis], np.int64), keepdims=int(keepdims))


class Namespace:
    """The functions of the array API that formulas of this package use on a :class:`Value`."""

    abs, sign, minimum, maximum = np.abs, np.sign, np.minimum, np.maximum

    @staticmethod
    def clip(x: Any, low: Any = None, high: Any = None) -> Any:
        """Within limits, which may be arrays."""
        x = x if low is None else np.maximum(x, low)
        return x if high is None else np.minimum(x, high)

    @staticmethod
    def where(condition: Value, a: Any, b: Any) -> Any:
        """The first where the condition holds."""
        values = [value for value in (a, b) if isinstance(value, Value)]
        graph = _innermost([condition.graph, *(value.graph for value in values)])
        dtype = values[0].dtype if values else np.result_type(a, b)
        a, b = (value if isinstance(value, Value) else graph.constant(value, dtype) for value in (a, b))
        return graph.op("Where", condition, a, b, dtype=dtype)

    @staticmethod
    def zeros_like(x: Any) -> Any:
        """0, of the same kind; it broadcasts."""
        return np.zeros_like(x) if isinstance(x, np.ndarray) else x.graph.constant(0, x.dtype)

    @staticmethod
    def ones_like(x: Any) -> Any:
        """1, of the same kind; it broadcasts."""
        return np.ones_like(x) if isinstance(x, np.ndarray) else x.graph.constant(1, x.dtype)

    @staticmethod
    def concat(values: Sequence[Value], axis: int = -1) -> Any:
        """Side by side."""
        return _innermost([value.graph for value in values]).op("Concat", *values, axis=axis)


def _innermost(graphs: Sequence[Graph]) -> Graph:
    """Of graphs inside each other: values of a graph around a loop are seen inside."""
    return max(graphs, key=lambda graph: graph.depth)
