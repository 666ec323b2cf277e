"""Lanes: 64 orbits in one value, for kernels that advance many orbits in lockstep.

A `Lanes` is LLVM's vector <64 x double>, or <64 x float> for an array of float32. The compiler
splits it across several machine registers (8 with AVX-512, 16 with AVX2). Each register carries an
independent chain of operations, and together the chains hide the latency of the arithmetic. The
speed of scalar code would depend on the auto-vectoriser. `load_few` loads fewer lanes, for kernels
with many variables.

`+ - * /` work on lanes, and between lanes and a float, which is broadcast to all lanes. `fma`,
`rint`, `fabs`, `copysign`, `maximum` and `minimum` take lanes or floats, so that a formula written
once compiles for lanes and for scalars. Both versions agree to the last bit on every machine (a
processor without fma falls back on a slow library call with the same result).

The functions of this module work only inside `numba.njit` functions. Without the compiler, under
NUMBA_DISABLE_JIT, importing the module raises an ImportError.
"""

import operator

from llvmlite import ir
from numba import config, types
from numba.core import cgutils
from numba.extending import intrinsic, models, overload, register_model

__all__ = ["LANES", "load", "own_frame", "store"]

if config.DISABLE_JIT:  # type: ignore[attr-defined]
    raise ImportError(
        "NUMBA_DISABLE_JIT is set, but orbits are advanced in vectors, which require compiled "
        "code; unset it",
        name="numba",
    )

LANES = 64
FEW = 16

_ELEMENTS = {types.float64: ir.DoubleType(), types.float32: ir.FloatType()}


class _LanesType(types.Type):
    def __init__(self, width, element):
        super().__init__(name=f"Lanes({width}, {element})")
        self.vector = ir.VectorType(_ELEMENTS[element], width)


@register_model(_LanesType)
class _LanesModel(models.PrimitiveModel):
    def __init__(self, dmm, fe_type):
        super().__init__(dmm, fe_type, fe_type.vector)


def _filled(builder, value, vector):
    """Return `value` itself if it is a vector, else a vector with this float in every lane."""
    if value.type == vector:
        return value
    if value.type != vector.element:  # value is a constant in a float32 kernel
        value = builder.fptrunc(value, vector.element)
    undefined = ir.Constant(vector, ir.Undefined)
    single = builder.insert_element(undefined, value, ir.Constant(ir.IntType(32), 0))
    indices = ir.Constant(ir.VectorType(ir.IntType(32), vector.count), [0] * vector.count)
    return builder.shuffle_vector(single, undefined, indices)


def _result(arguments):
    """Return the type of a result: lanes if any argument is lanes, else the common float type.

    Return None (no match) for any other combination of types.
    """
    kinds = {a for a in arguments if a not in _ELEMENTS} or set(arguments)
    kind = kinds.pop()
    return None if kinds or not (isinstance(kind, _LanesType) or kind in _ELEMENTS) else kind


def _elementwise(emit):
    """Return the code generator of an elementwise operation; `emit` takes operands of one type."""

    def generate(context, builder, signature, arguments):
        if isinstance(signature.return_type, _LanesType):
            arguments = [_filled(builder, a, signature.return_type.vector) for a in arguments]
        return emit(builder, *arguments)

    return generate


def _llvm(name):
    """Return a function that emits calls to an LLVM intrinsic for the type of its operands."""

    def emit(builder, *operands):
        kind = operands[0].type
        size = "f32" if getattr(kind, "element", kind) == ir.FloatType() else "f64"
        suffix = f"v{kind.count}{size}" if isinstance(kind, ir.VectorType) else size
        signature = ir.FunctionType(kind, [kind] * len(operands))
        function = cgutils.get_or_insert_function(
            builder.module, signature, f"llvm.{name}.{suffix}"
        )
        return builder.call(function, operands)

    return emit


def _of_one(emit, words):
    def operation(typing_context, a):
        result = _result([a])
        return result and (result(a), _elementwise(emit))

    operation.__doc__ = words
    return intrinsic(operation)


def _of_two(emit, words):
    def operation(typing_context, a, b):
        result = _result([a, b])
        return result and (result(a, b), _elementwise(emit))

    operation.__doc__ = words
    return intrinsic(operation)


@intrinsic
def fma(typing_context, a, b, c):
    """a·b + c, rounded once."""
    result = _result([a, b, c])
    return result and (result(a, b, c), _elementwise(_llvm("fma")))


def _select(comparison):
    def emit(builder, a, b):
        # Comparison and selection together compile to one instruction; LLVM's own maxnum is slower
        # because of its rules about NaN.
        return builder.select(builder.fcmp_ordered(comparison, a, b), a, b)

    return emit


rint = _of_one(_llvm("rint"), "The integer nearest to a, halves to even.")
fabs = _of_one(_llvm("fabs"), "|a|")
copysign = _of_two(_llvm("copysign"), "|a| with the sign of b.")
maximum = _of_two(_select(">"), "The larger of a and b; b if either is NaN.")
minimum = _of_two(_select("<"), "The smaller of a and b; b if either is NaN.")


def _overload_operator(python_operator, instruction):
    operation = _of_two(lambda builder, a, b: getattr(builder, instruction)(a, b), instruction)

    @overload(python_operator)
    def operate(a, b):
        if isinstance(_result([a, b]), _LanesType):
            return lambda a, b: operation(a, b)
        return None


_overload_operator(operator.add, "fadd")
_overload_operator(operator.sub, "fsub")
_overload_operator(operator.mul, "fmul")
_overload_operator(operator.truediv, "fdiv")


@overload(operator.neg)
def _negate(a):
    return (lambda a: a * -1.0) if isinstance(a, _LanesType) else None


def _pointer(context, builder, array_type, kind, array, index):
    """Return a pointer to array[index] of type `kind`, which is lanes or a float."""
    place = builder.gep(context.make_array(array_type)(context, builder, array).data, [index])
    return place if kind in _ELEMENTS else builder.bitcast(place, kind.vector.as_pointer())


def _load(width):
    def generate(context, builder, signature, arguments):
        array_type, kind = signature.args[0], signature.return_type
        return builder.load(_pointer(context, builder, array_type, kind, *arguments), align=4)

    def load(typing_context, array, index):
        return _LanesType(width, array.dtype)(array, types.intp), generate

    load.__doc__ = f"Lanes from array[index : index + {width}]; contiguous floats, not checked."
    return intrinsic(load)


load, load_few = _load(LANES), _load(FEW)


@intrinsic
def store(typing_context, array, index, lanes):
    """Set array[index : index + width] = lanes; contiguity and equal types are not checked."""

    def generate(context, builder, signature, arguments):
        array_type, _, kind = signature.args
        pointer = _pointer(context, builder, array_type, kind, *arguments[:2])
        builder.store(arguments[2], pointer, align=4)
        return context.get_dummy_value()

    return types.void(array, types.intp, lanes), generate


@intrinsic(prefer_literal=True)
def load_state(typing_context, array, column, n_rows, width):
    """Load `width` columns, starting at `column`, of the first n_rows rows of an array.

    The array has FEW columns; n_rows and width are compile-time constants. The result is a tuple
    with one entry per row: `width` lanes, or a float if width is 1.
    """
    n, size = n_rows.literal_value, width.literal_value
    kind = _LanesType(size, types.float64) if size > 1 else types.float64

    def generate(context, builder, signature, arguments):
        values = []
        for row in range(n):
            index = builder.add(arguments[1], ir.Constant(arguments[1].type, row * FEW))
            pointer = _pointer(context, builder, array, kind, arguments[0], index)
            values.append(builder.load(pointer, align=8))
        return context.make_tuple(builder, signature.return_type, values)

    return types.UniTuple(kind, n)(array, types.intp, n_rows, width), generate


@intrinsic
def store_state(typing_context, array, state):
    """Store a tuple, whose entries are FEW lanes each, as the first rows of an array."""

    def generate(context, builder, signature, arguments):
        for row in range(state.count):
            index = ir.Constant(ir.IntType(64), row * FEW)
            pointer = _pointer(context, builder, array, state.dtype, arguments[0], index)
            builder.store(builder.extract_value(arguments[1], row), pointer, align=8)
        return context.get_dummy_value()

    return types.void(array, state), generate


@intrinsic
def own_frame(typing_context):
    """Give the calling function a stack frame of its own, aligned to a cache line.

    Some lanes always spill to the stack. If the frame is aligned only by chance, a spill may
    straddle two cache lines. This slows down some runs of a program by 10-30%, and
    others not at all.
    """

    def generate(context, builder, signature, arguments):
        builder.function.attributes.add("noinline")
        builder.function.attributes.alignstack = 64
        return context.get_dummy_value()

    return types.void(), generate
