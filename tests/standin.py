"""A device other than the CPU where there is no GPU: what would fail on a GPU fails here, by the same rules.

Its tensors are computed by the CPU, so that what runs on it must give what the CPU gives, bit for bit. It refuses what
CUDA refuses: tensors of two devices in one operation (apart from numbers, copies and row numbers), a generator of the
CPU, and a conversion to numpy. It stays for as long as the process, so it is used in a process of its own.
"""

import torch
from torch.utils._pytree import tree_leaves, tree_map
from torch.utils.backend_registration import _DummyBackendModule, _setup_privateuseone_for_python_backend

NAME = "standin"
COPIES = ("copy_", "_copy_from", "_to_copy")  # may join two devices
ROWS = ("index", "index_put", "index_put_", "_unsafe_index", "_index_put_impl_")  # take row numbers from the CPU


class _Module(_DummyBackendModule):
    """``torch.standin``, as ``torch.cuda`` is there for CUDA."""

    def synchronize(self, device=None):
        pass

    def get_rng_state(self, device="standin"):
        return torch.get_rng_state()

    def set_rng_state(self, state, device="standin"):
        torch.set_rng_state(state)


class Standin(torch.Tensor):
    """A tensor on the device, with the one on the CPU that it stands for."""

    @staticmethod
    def __new__(cls, held):
        return torch.Tensor._make_wrapper_subclass(
            cls, held.shape, strides=held.stride(), storage_offset=held.storage_offset(), dtype=held.dtype,
            device=torch.device(f"{NAME}:0"),
        )  # fmt: skip

    def __init__(self, held):
        self.held = held

    __torch_function__ = torch._C._disabled_torch_function_impl  # pyright: ignore[reportAssignmentType]  # as torch says

    @classmethod
    def __torch_dispatch__(cls, function, types, args=(), kwargs=None):
        return run(function, *args, **(kwargs or {}))

    def __repr__(self, **_):
        return f"Standin({self.held!r})"

    @property
    def data(self):
        return self.detach()

    @data.setter
    def data(self, other):
        self.held = other.held

    def numpy(self, **_):
        raise TypeError(f"can't convert {NAME} device type tensor to numpy: use Tensor.cpu() first")

    def tolist(self):
        return self.held.tolist()

    def __reduce_ex__(self, protocol):
        return self.held.clone().__reduce_ex__(protocol)  # as torch.load with map_location="cpu"

    def __deepcopy__(self, memo):
        copy = Standin(self.held.clone()).requires_grad_(self.requires_grad)
        return torch.nn.Parameter(copy, self.requires_grad) if isinstance(self, torch.nn.Parameter) else copy


def run(function, *args, **kwargs):
    """An operation of which something lies on the device, by the CPU."""
    name = function._schema.name.split("::")[-1]
    leaves = tree_leaves((args, kwargs))
    ours = [leaf for leaf in leaves if isinstance(leaf, Standin)]
    if name not in COPIES and ours:
        looked_at = tree_leaves((args[0], args[2:], kwargs)) if name in ROWS else leaves
        alien = [x for x in looked_at if isinstance(x, torch.Tensor) and not isinstance(x, Standin) and x.ndim]
        if alien:
            raise RuntimeError(f"{function}: expected all tensors on {NAME}, one of shape {[*alien[0].shape]} is not")
    if any(isinstance(leaf, torch.Generator) for leaf in leaves):
        raise RuntimeError(f"{function}: expected a generator of {NAME}, found one of the CPU")
    wanted = kwargs.get("device")
    there = torch.device(wanted).type == NAME if wanted is not None else bool(ours)
    if wanted is not None:
        kwargs["device"] = "cpu"
    kwargs.pop("pin_memory", None)
    made = function(*map(_held, args), **{key: _held(value) for key, value in kwargs.items()})
    given = dict(zip((argument.name for argument in function._schema.arguments), args, strict=False)) | kwargs
    written = [given[x.name] for x in function._schema.arguments if x.alias_info is not None and x.alias_info.is_write]
    if written and function._schema.returns:  # an operation in place, or one with out=
        return written[0] if len(written) == 1 else tuple(written)
    wrap = lambda x: Standin(x) if there and type(x) is torch.Tensor else x  # noqa: E731
    return tree_map(wrap, made)


def _held(values):
    return tree_map(lambda value: value.held if isinstance(value, Standin) else value, values)


def _by_way_of_the_cpu(make):
    """``torch.tensor`` with a copy at its end: torch makes none from plain numbers on a device that Python defines."""

    def made(data, *, dtype=None, device=None, **more):
        if device is None or torch.device(device).type != NAME or isinstance(data, Standin):
            return make(data, dtype=dtype, device=device, **more)
        return make(data, dtype=dtype, device="cpu", **more).to(device)

    return made


def register():
    """Make ``device="standin"`` known to torch."""
    _setup_privateuseone_for_python_backend(NAME, _Module())
    for make in (torch.tensor, torch.as_tensor, torch.asarray):
        setattr(torch, make.__name__, _by_way_of_the_cpu(make))
    library = torch.library.Library("_", "IMPL")
    library.fallback(run, "PrivateUse1")
    return library  # as long as it is kept
