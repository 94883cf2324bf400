# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""NumPy's PCG64 at any place: one draw alone, without those before it.

A step of the generator is x -> a x + c modulo 2^128, so n steps are x -> A_n x + G_n c with
numbers that depend on n alone (O'Neill, PCG, 2014, Section 4.3.1). A loop that looks at three of
a robot's twelve draws of a time step makes three. Numba computes with 128 bits as a C compiler
does; plain Python has its own integers, and makes the same bits.
"""

from collections.abc import Callable
from importlib import import_module
from typing import Any

import numpy as np

from sparse_coord_ros.base.compiling import before_compiling
from sparse_coord_ros.core.game.streams import bit_generator

MULTIPLIER = 0x2360ED051FC65DA44385DF649FCCF645
"""a of PCG64."""

MOST = 128
"""Steps that `jump_table` knows."""

WORD = 64
_LOW = (1 << WORD) - 1
_WHOLE = (1 << 2 * WORD) - 1
_UNIT = 1.0 / (1 << 53)


def jump_table() -> np.ndarray:
    """Return A_n and G_n of n = 0 to `MOST` steps: high and low word each; uint64, (n, 4)."""
    rows = []
    power = 1
    total = 0
    for _ in range(MOST + 1):
        rows.append([*divmod(power, 2**WORD), *divmod(total, 2**WORD)])
        power = power * MULTIPLIER & _WHOLE
        total = (total * MULTIPLIER + 1) & _WHOLE
    return np.array(rows, dtype=np.uint64)


def source_of(
    seed: int, agent: int, role: int, phase: int, drawn: int = 0
) -> list[int]:
    """Return a stream's generator, ready for its next draw.

    Args:
        seed: as of `core.game.streams.Stream`, as the next three.
        agent: the robot's number.
        role: one of the roles.
        phase: LEARNING or EVALUATION.
        drawn: draws that were made before.

    Returns:
        High and low word of its state, and of c.
    """
    generator = bit_generator(seed, agent, role, phase)
    if drawn:
        generator.advance(drawn)
    state = generator.state["state"]
    return [*divmod(state["state"], 2**WORD), *divmod(state["inc"], 2**WORD)]


def jumped(source: np.ndarray, jump: np.ndarray) -> tuple[int, int]:
    """Return high and low word of a generator's state after a jump; its state stays.

    Args:
        source: high and low word of state and c.
        jump: a row of `jump_table`.
    """
    high, low, more_high, more_low = (int(word) for word in source)
    a_high, a_low, g_high, g_low = (int(word) for word in jump)
    state = (high << WORD | low) * (a_high << WORD | a_low)
    state += (more_high << WORD | more_low) * (g_high << WORD | g_low)
    return (state & _WHOLE) >> WORD, state & _LOW


def uniform(high: int, low: int) -> float:
    """Return the draw in [0, 1) of a state: PCG XSL-RR, and the upper 53 bits of what it gives."""
    folded = high ^ low
    turn = high >> 58
    bits = (folded >> turn | folded << (-turn & 63)) & _LOW
    return (bits >> 11) * _UNIT


@before_compiling
def _let_call(options: dict[str, Any]) -> None:
    """Let numba's loops call `jumped` and `uniform`.

    Args:
        options: of numba's compiler.
    """
    names = ("llvmlite.ir", "numba.core.types", "numba.extending")
    ir, types, extending = map(import_module, names)
    word = ir.IntType(WORD)
    wide = ir.IntType(2 * WORD)

    def words_of_sum(
        _: Any, x1: Any, x0: Any, c1: Any, c0: Any, a1: Any, a0: Any, g1: Any, g0: Any
    ) -> tuple[Any, Callable[..., Any]]:
        """Return the type and the code of the words of x a + c g, high and low."""

        def generate(context: Any, builder: Any, signature: Any, given: Any) -> Any:
            whole = [
                builder.or_(
                    builder.shl(builder.zext(high, wide), ir.Constant(wide, WORD)),
                    builder.zext(low, wide),
                )
                for high, low in zip(given[::2], given[1::2], strict=True)
            ]
            state, more, power, total = whole
            state = builder.add(builder.mul(state, power), builder.mul(more, total))
            high = builder.trunc(builder.lshr(state, ir.Constant(wide, WORD)), word)
            return context.make_tuple(
                builder, signature.return_type, (high, builder.trunc(state, word))
            )

        pair = types.UniTuple(types.uint64, 2)
        return pair(*[types.uint64] * 8), generate

    product_sum = extending.intrinsic(words_of_sum)
    shift = np.uint64(58)
    around = np.uint64(63)
    unused = np.uint64(11)

    # Numba wants the very signature of the function outside, annotations included.
    def make_jumped(source: Any, jump: Any) -> Callable[..., Any]:
        def jumped(source: Any, jump: Any) -> Any:
            return product_sum(
                source[0],
                source[1],
                source[2],
                source[3],
                jump[0],
                jump[1],
                jump[2],
                jump[3],
            )

        return jumped

    def make_uniform(high: Any, low: Any) -> Callable[..., Any]:
        def uniform(high: Any, low: Any) -> Any:
            folded = high ^ low
            turn = high >> shift
            back = (np.uint64(64) - turn) & around
            bits = folded >> turn | folded << back
            return np.float64(bits >> unused) * _UNIT

        return uniform

    extending.overload(jumped, jit_options=options)(make_jumped)
    extending.overload(uniform, jit_options=options)(make_uniform)
