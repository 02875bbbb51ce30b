"""How kernels take a named tuple: as one address, not as each of its arrays by itself.

Numba passes a tuple by value: the bank's state and settings are some thousand numbers in each of hundreds of kernels
that take them, at each of their calls, and to compile these took 479 s where it takes 242 now. Here the wrapper that
unpacks Python's objects lays the tuple out in memory, and kernels load from there the field that they want. Nobody
writes to it, so loads are marked as invariant: an array's address and shape stay in registers in a loop that writes to
arrays.

Imported with numba, when the first kernel runs; the classes are those of `compiled.passed_by_reference`.

References
----------
LLVM Language Reference Manual, metadata ``invariant.load``. Numba documentation, "Low-level extension API".
"""

from __future__ import annotations

import hashlib
from collections.abc import Iterable
from typing import Any

from numba import types
from numba.core import cgutils
from numba.core.typing.templates import AttributeTemplate
from numba.extending import (
    NativeValue,
    infer_getattr,
    lower_getattr_generic,
    models,
    register_model,
    typeof_impl,
    unbox,
)


class Reference(types.Type):  # type: ignore[misc]
    """Type of the address of a named tuple.

    Parameters
    ----------
    made
        The class.
    members
        Types of its fields.
    """

    def __init__(self, made: type, members: Iterable[Any]) -> None:
        """Take them; see the class."""
        self.members = tuple(members)
        self.places = {name: place for place, name in enumerate(vars(made)["_fields"])}
        text = ", ".join(map(str, self.members))
        self._short = f"{made.__name__}_{hashlib.sha256(text.encode()).hexdigest()[:16]}"
        super().__init__(f"reference({made.__module__}.{made.__qualname__}: {text})")

    @property
    def mangling_args(self) -> tuple[str, tuple[()]]:
        """What stands for it in the names of compiled kernels: the whole would be thousands of letters."""
        return self._short, ()


@register_model(Reference)
class ReferenceModel(models.PrimitiveModel):  # type: ignore[misc]
    """An address of the fields, laid out as they are in arrays."""

    def __init__(self, manager: Any, reference: Reference) -> None:
        """Lay them out."""
        self.fields = manager.lookup(types.Tuple(reference.members)).get_data_type()
        super().__init__(manager, reference, self.fields.as_pointer())


@infer_getattr
class ReferenceAttributes(AttributeTemplate):  # type: ignore[misc]
    """Types of the fields, by name."""

    key = Reference

    def generic_resolve(self, reference: Reference, name: str) -> Any:
        """Return the type of a field; None where there is none of this name."""
        return reference.members[reference.places[name]] if name in reference.places else None


@lower_getattr_generic(Reference)  # type: ignore[untyped-decorator]
def load_field(context: Any, builder: Any, reference: Reference, address: Any, name: str) -> Any:
    """Load a field; of an array what is used of one that nobody counts."""
    place = reference.places[name]
    kind = reference.members[place]
    field = cgutils.gep_inbounds(builder, address, 0, place)
    if not isinstance(kind, types.Array):
        return context.data_model_manager[kind].from_data(builder, _load(builder, field))
    array = context.make_array(kind)(context, builder)
    place_of = context.data_model_manager[kind].get_field_position
    for name in ("nitems", "data", "shape", "strides"):
        setattr(array, name, _load(builder, cgutils.gep_inbounds(builder, field, 0, place_of(name))))
    array.itemsize = context.get_constant(types.intp, context.get_abi_sizeof(context.get_data_type(kind.dtype)))
    for name in ("meminfo", "parent"):
        setattr(array, name, cgutils.get_null_value(getattr(array, name).type))
    return array._getvalue()


def _load(builder: Any, address: Any) -> Any:
    """Load a value, number by number, each as one that does not change."""
    kind = address.type.pointee
    if not hasattr(kind, "elements"):
        value = builder.load(address)
        value.set_metadata("invariant.load", builder.module.add_metadata([]))
        return value
    whole = cgutils.get_null_value(kind)
    for place in range(len(kind)):
        part = _load(builder, cgutils.gep_inbounds(builder, address, 0, place))
        whole = builder.insert_value(whole, part, place)
    return whole


@unbox(Reference)  # type: ignore[untyped-decorator]
def lay_out(reference: Reference, tuple_: Any, c: Any) -> NativeValue:
    """Lay a tuple out in the frame of the wrapper, which is there as long as the call."""
    manager, builder = c.context.data_model_manager, c.builder
    frame = cgutils.alloca_once(builder, manager[reference].fields)
    failed: Any = cgutils.alloca_once_value(builder, cgutils.false_bit)
    cleanups = []
    for place, kind in enumerate(reference.members):
        native = c.unbox(kind, c.pyapi.tuple_getitem(tuple_, place))
        data = manager[kind].as_data(builder, native.value)
        builder.store(data, cgutils.gep_inbounds(builder, frame, 0, place))
        builder.store(builder.or_(builder.load(failed), native.is_error), failed)
        if native.cleanup is not None:
            cleanups.append(native.cleanup)

    def clean_up() -> None:
        for one in reversed(cleanups):
            one()

    return NativeValue(_forget_origin(builder, c.pyapi, frame), builder.load(failed), clean_up if cleanups else None)


def _forget_origin(builder: Any, api: Any, address: Any) -> Any:
    """Return the address by way of an integer of Python's.

    Else a kernel that becomes part of its wrapper would write the frame and load it as invariant in one function, and
    the optimiser were free to do the one after the other.
    """
    number = api.long_from_ulonglong(builder.ptrtoint(address, cgutils.intp_t))
    found = api.long_as_voidptr(number)
    api.decref(number)
    return builder.bitcast(found, address.type)


def register(record: type) -> None:
    """Have numba take the tuples of a class for references, wherever a kernel is given one."""
    typeof_impl.register(record)(_reference_to)


def _reference_to(value: Any, context: Any) -> Reference:
    return Reference(type(value), [typeof_impl(one, context) for one in value])
