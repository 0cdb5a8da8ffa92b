"""Lanes: eight numbers that a processor computes with at once. Formulas on them are written as for one number.

A processor core of today can add eight pairs of doubles in the time of one pair, if one instruction names all eight:
SIMD, "single instruction, multiple data" (AVX-512 on x86; elsewhere the compiler makes two or four instructions of
it). Code for one number does not become such code by itself: LLVM, the compiler that Numba uses, finds no loop over
problems inside a solver. So this module gives Numba three types whose every operation is done for eight numbers:

``Lanes``
    Eight doubles, one of each of eight problems: ``<8 x double>`` in LLVM. ``a * b + c`` multiplies and adds lane by
    lane. An ordinary number beside them counts as eight equal ones.
``Mask``
    Eight truth values, the result of ``a > b``: ``<8 x i1>``. Combine them by ``&``, ``|``, ``~``; ``!=`` is "either
    but not both".
``LaneArray``, ``MaskArray``
    Vectors and matrices of those: ``J[i, a]`` is a ``Lanes``, and ``J[i, a, w]`` is its number in lane w. In memory,
    the eight numbers of an entry are adjacent.

What cannot be written as for one number is a choice, since ``if`` cannot go both ways. ``compiling.where(mask, a, b)``
takes a where the mask is true and b elsewhere, and ``compiling.nowhere(mask)`` is true if no lane has it, so that work
may be skipped. For one number they are ``a if mask else b`` and ``not mask``. A function that has no other choices is
compiled from one source for one number and for lanes.

How Numba compiles an operation: a *typing template* tells it the type of the result (``_typed``), and a *lowering*
writes the instruction by llvmlite's builder ``b`` (``fadd``, ``select``...). Registered for an operator of Python, they
apply wherever the compiled source has that operator.

``FLAGS`` permit the compiler what a processor does best: ``contract`` fuses a product and a sum into one instruction
that rounds once, ``arcp`` replaces several divisions by one number by one division, ``nsz`` neglects the sign of zero.
So lanes and the same source for one number differ by rounding. Within lanes, no result depends on the neighbours.
"""

from __future__ import annotations

import math
import operator
from collections.abc import Callable
from typing import Any, NamedTuple, cast

import numpy as np
from llvmlite import ir
from numba import extending, types
from numba.core import cgutils, imputils
from numba.core.typeconv.castgraph import Conversion
from numba.core.typing import templates
from numba.core.typing.templates import AbstractTemplate, signature
from numba.extending import models, register_model

from cdpr_sim.core.compiling import WIDTH, compile_as, matrix, nowhere, truths, vector, where

# Numba's annotations of these are wrong.
intrinsic = cast(Any, extending.intrinsic)
lower_builtin = cast(Any, imputils.lower_builtin)
lower_cast = cast(Any, imputils.lower_cast)
infer_global = cast(Any, templates.infer_global)

FLAGS = ("contract", "nsz", "arcp")

_INT, _DOUBLE, _BYTE = ir.IntType(64), ir.DoubleType(), ir.IntType(WIDTH)
_VECTOR, _BITS = ir.VectorType(_DOUBLE, WIDTH), ir.VectorType(ir.IntType(1), WIDTH)


# --- types --------------------------------------------------------------------------------------------------------


class Many(types.Type):
    """Lanes or masks. Numbers, or truth values, convert to them: eight equal ones."""

    ones: Any = ()

    def unify(self, typingctx: Any, other: Any) -> Any:
        """Type of a variable that is an ``other`` on one branch and this on another."""
        return self if isinstance(other, self.ones) else None

    def can_convert_from(self, typingctx: Any, other: Any) -> Any:
        """Whether an ``other`` converts to this."""
        return Conversion.safe if isinstance(other, self.ones) else None


class LanesType(Many):
    """Eight doubles."""

    ones = (types.Integer, types.Float)


class MaskType(Many):
    """Eight truth values."""

    ones = (types.Boolean,)


class LaneArrayType(types.Type):
    """Vector, or matrix with this number of columns, of lanes or masks."""

    def __init__(self, entry: Many, columns: int = 0) -> None:
        self.entry, self.columns = entry, columns
        super().__init__(f"{entry.name}Array{columns}")


LANES, MASK = LanesType("Lanes"), MaskType("Mask")


@register_model(LanesType)
class _LanesModel(models.PrimitiveModel):
    def __init__(self, manager: Any, kind: Any) -> None:
        super().__init__(manager, kind, _VECTOR)


@register_model(MaskType)
class _MaskModel(models.PrimitiveModel):
    def __init__(self, manager: Any, kind: Any) -> None:
        super().__init__(manager, kind, _BITS)


@register_model(LaneArrayType)
class _LaneArrayModel(models.StructModel):
    def __init__(self, manager: Any, kind: Any) -> None:
        stored = types.float64 if kind.entry is LANES else types.uint8
        super().__init__(manager, kind, [("start", types.CPointer(stored)), ("length", types.int64)])


def _equal(b: Any, value: Any, kind: Any) -> Any:
    """A vector of equal entries."""
    vector = b.insert_element(ir.Constant(kind, ir.Undefined), value, ir.Constant(ir.IntType(32), 0))
    return b.shuffle_vector(vector, vector, ir.Constant(ir.VectorType(ir.IntType(32), WIDTH), [0] * WIDTH))


@lower_cast(types.Integer, LanesType)
@lower_cast(types.Float, LanesType)
def _from_number(context, b, source, target, value):
    return _equal(b, context.cast(b, value, source, types.float64), _VECTOR)


@lower_cast(types.Boolean, MaskType)
def _from_truth(context, b, source, target, value):
    return _equal(b, context.cast(b, value, source, types.boolean), _BITS)


# --- operators ----------------------------------------------------------------------------------------------------


def _typed(function: Any, entry: Many, result: Many, number: int, emit: Any) -> None:
    """Let ``function`` of ``number`` arguments, some of type ``entry``, give ``result`` by the code of ``emit``."""

    class Template(AbstractTemplate):
        key = function

        def generic(self, args: Any, kws: Any) -> Any:
            fit = len(args) == number and not kws and entry in args
            if fit and all(one is entry or isinstance(one, entry.ones) for one in args):
                return signature(result, *[entry] * number)

    infer_global(function, types.Function(Template))  # as a decorator, it fails for functions of NumPy 2.0
    lower_builtin(function, *[type(entry)] * number)(lambda context, b, sig, args: emit(b, *args))


def _called(name: str) -> Any:
    """Code that calls LLVM's own function of lanes."""
    kind = ir.FunctionType(_VECTOR, [_VECTOR])
    return lambda b, x: b.call(cgutils.get_or_insert_function(b.module, kind, f"llvm.{name}.v{WIDTH}f64"), [x])


def _flagged(name: str) -> Any:
    return lambda b, *of: getattr(b, name)(*of, flags=FLAGS)


for _name, _code in {"add": "fadd", "sub": "fsub", "mul": "fmul", "truediv": "fdiv"}.items():
    for _operator in (getattr(operator, _name), getattr(operator, "i" + _name)):  # a + b, a += b
        _typed(_operator, LANES, LANES, 2, _flagged(_code))
_typed(operator.neg, LANES, LANES, 1, _flagged("fneg"))
for _name, _sign in {"gt": ">", "ge": ">=", "lt": "<", "le": "<=", "eq": "=="}.items():
    _typed(getattr(operator, _name), LANES, MASK, 2, (lambda sign: lambda b, x, y: b.fcmp_ordered(sign, x, y))(_sign))
_typed(operator.ne, LANES, MASK, 2, lambda b, x, y: b.fcmp_unordered("!=", x, y))
for _operator, _code in {
    operator.and_: "and_", operator.iand: "and_", operator.or_: "or_", operator.ior: "or_", operator.ne: "xor",
}.items():  # fmt: skip
    _typed(_operator, MASK, MASK, 2, (lambda code: lambda b, x, y: getattr(b, code)(x, y))(_code))
_typed(operator.eq, MASK, MASK, 2, lambda b, x, y: b.not_(b.xor(x, y)))
_typed(operator.invert, MASK, MASK, 1, lambda b, x: b.not_(x))
for _function in (math.sqrt, np.sqrt):
    _typed(_function, LANES, LANES, 1, _called("sqrt"))
_typed(abs, LANES, LANES, 1, _called("fabs"))
# As Python's, max(x, y) is x unless y is larger, so a nan as x remains.
for _function in (max, np.maximum):
    _typed(_function, LANES, LANES, 2, lambda b, x, y: b.select(b.fcmp_ordered(">", y, x), y, x))
for _function in (min, np.minimum):
    _typed(_function, LANES, LANES, 2, lambda b, x, y: b.select(b.fcmp_ordered("<", y, x), y, x))


# --- choices ------------------------------------------------------------------------------------------------------


@intrinsic
def _select(context, mask, x, y):
    entry = MASK if MASK in (x, y) or isinstance(x, types.Boolean) else LANES
    return entry(mask, entry, entry), lambda context, b, sig, args: b.select(*args)


def of_lanes(function: Callable) -> Callable:
    """Decorator of what compiled code calls in place of ``function`` if the first argument is lanes or a mask."""

    def register(code: Callable) -> Callable:
        compile_as(function, lambda first, *_: code if isinstance(first, Many) else None, forceinline=True)
        return code

    return register


@of_lanes(where)
def _where(mask, x, y):
    return _select(mask, x, y)


@of_lanes(nowhere)
def _nowhere(mask):
    return bits_of(mask) == 0


@intrinsic
def bits_of(context, mask):
    """The truth values as an integer, the first lane's in its lowest bit."""
    return types.int64(MASK), lambda context, b, sig, args: b.zext(b.bitcast(args[0], _BYTE), _INT)


@intrinsic
def mask_of(context, bits):
    """The mask whose ``bits_of`` these are."""
    return MASK(types.int64), lambda context, b, sig, args: b.bitcast(b.trunc(args[0], _BYTE), _BITS)


@intrinsic
def everywhere(context, number):
    """Eight equal numbers."""
    return LANES(LANES), lambda context, b, sig, args: args[0]


# --- arrays -------------------------------------------------------------------------------------------------------

_STEP = {LANES: WIDTH, MASK: 1}
"""Doubles of an entry; bytes of a mask."""


@intrinsic(prefer_literal=True)
def _array_at(context, memory, first, length, columns):
    """Array of so many rows and columns, 0 of a vector, in memory from an entry on; the memory must outlive the array.

    An entry of lanes is WIDTH doubles, one of masks is a byte.
    """
    entry = LANES if memory.dtype is types.float64 else MASK
    kind = LaneArrayType(entry, columns.literal_value)

    def code(context, b, sig, args):
        memory = context.make_array(sig.args[0])(context, b, args[0])
        made = cgutils.create_struct_proxy(kind)(context, b)
        made.start = b.gep(memory.data, [b.mul(args[1], ir.Constant(_INT, _STEP[entry]))])
        made.length = args[2]
        return made._getvalue()

    return kind(memory, types.int64, types.int64, columns), code


class Room(NamedTuple):
    """Memory of lane arrays, and how many entries of it are taken: of numbers, and of masks; ``compiling.Heap`` here.

    ``Kernel`` makes the memory, outside compiled code, so that it outlives the arrays.
    """

    numbers: np.ndarray
    flags: np.ndarray
    taken: np.ndarray


@vector.of(Room)
def _vector(room, length):
    room.taken[0] += length
    return _array_at(room.numbers, room.taken[0] - length, length, 0)


@matrix.of(Room)
def _matrix(room, rows, columns):
    room.taken[0] += rows * columns
    return _array_at(room.numbers, room.taken[0] - rows * columns, rows, columns)


@truths.of(Room)
def _masks(room, length):
    room.taken[1] += length
    return _array_at(room.flags, room.taken[1] - length, length, 0)


def _index_of(array: Any, index: Any) -> tuple[Any, Any]:
    """Types of the index and of what lies there: an entry, or with one index more the number of one lane."""
    dimensions = getattr(index, "count", 1)
    kind = types.UniTuple(types.intp, dimensions) if dimensions > 1 else types.intp
    return kind, types.float64 if dimensions > (2 if array.columns else 1) else array.entry


def _place(context: Any, b: Any, sig: Any, args: Any) -> Any:
    """Address of an entry, or of one number in it."""
    kind, index = sig.args[:2]
    array = cgutils.create_struct_proxy(kind)(context, b, value=args[0])
    indices = cgutils.unpack_tuple(b, args[1]) if isinstance(index, types.UniTuple) else [args[1]]
    entry = indices[0]
    if kind.columns:
        entry = b.add(b.mul(entry, ir.Constant(_INT, kind.columns)), indices[1])
    place = b.gep(array.start, [b.mul(entry, ir.Constant(_INT, _STEP[kind.entry]))])
    if len(indices) > (2 if kind.columns else 1):
        return b.gep(place, [indices[-1]])
    return place if kind.entry is MASK else b.bitcast(place, _VECTOR.as_pointer())


@infer_global(operator.getitem)
class _Get(AbstractTemplate):
    def generic(self, args: Any, kws: Any) -> Any:
        if isinstance(args[0], LaneArrayType):
            index, entry = _index_of(*args)
            return signature(entry, args[0], index)


@infer_global(operator.setitem)
class _Set(AbstractTemplate):
    def generic(self, args: Any, kws: Any) -> Any:
        if isinstance(args[0], LaneArrayType):
            index, entry = _index_of(*args[:2])
            return signature(types.none, args[0], index, entry)


@infer_global(len)
class _Length(AbstractTemplate):
    def generic(self, args: Any, kws: Any) -> Any:
        if isinstance(args[0], LaneArrayType):
            return signature(types.intp, args[0])


@lower_builtin(operator.getitem, LaneArrayType, types.Any)
def _get(context, b, sig, args):
    place = _place(context, b, sig, args)
    return b.bitcast(b.load(place), _BITS) if sig.return_type is MASK else b.load(place, align=8)


@lower_builtin(operator.setitem, LaneArrayType, types.Any, types.Any)
def _set(context, b, sig, args):
    place = _place(context, b, sig, args)
    if sig.args[2] is MASK:
        b.store(b.bitcast(args[2], _BYTE), place)
    else:
        b.store(args[2], place, align=8)
    return context.get_dummy_value()


@lower_builtin(len, LaneArrayType)
def _length(context, b, sig, args):
    return cgutils.create_struct_proxy(sig.args[0])(context, b, value=args[0]).length
