"""CasADi functions that carry their own Jacobian, on disk and in memory."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping
from typing import Any

import casadi as ca

_OF_C = (  # and of C++, whose programs include the header
    "alignas alignof and and_eq asm auto bitand bitor bool break case catch char class compl concept const "
    "const_cast constexpr continue decltype default delete do double dynamic_cast else enum explicit export "
    "extern false float for friend goto if inline int long main mutable namespace new noexcept not not_eq nullptr "
    "operator or or_eq private protected public register reinterpret_cast requires restrict return short signed "
    "sizeof static static_assert static_cast struct switch template this thread_local throw true try typedef "
    "typeid typename typeof union unsigned using virtual void volatile wchar_t while xor xor_eq"
)
RESERVED_NAMES = frozenset(("jac", "hess", "null", *_OF_C.split()))
_OF_MATH = (  # <math.h> of C99 and of POSIX
    "acos acosh asin asinh atan atan2 atanh cbrt ceil copysign cos cosh erf erfc exp exp2 expm1 fabs fdim floor fma "
    "fmax fmin fmod frexp hypot ilogb ldexp lgamma llrint llround log log10 log1p log2 logb lrint lround modf nan "
    "nearbyint nextafter nexttoward pow remainder remquo rint round scalbln scalbn sin sinh sqrt tan tanh tgamma trunc "
    "drem exp10 finite gamma isinf isnan j0 j1 jn scalb significand sincos y0 y1 yn"
)
_OF_STRING = (  # and macros of <math.h>, <stdio.h> and <stdlib.h>, which the example and an FMU include
    "fpclassify isfinite isgreater isgreaterequal isless islessequal islessgreater isnormal isunordered lgamma_r "
    "signbit signgam HUGE_VAL INFINITY NAN NULL basename bcmp bcopy bzero ffs index memccpy memchr memcmp memcpy "
    "memmem memmove mempcpy memset rindex stpcpy strcasecmp strcat strchr strcmp strcoll strcpy strcspn strdup "
    "strerror strlen strncat strncmp strncpy strndup strnlen strpbrk strrchr strsep strsignal strspn strstr strtok "
    "strxfrm abort abs atexit atof atoi calloc div exit fclose fopen fprintf fputs free getc getchar getenv gets "
    "labs malloc perror printf putchar puts qsort rand realloc remove rename scanf snprintf sprintf stderr stdin "
    "stdout system"
)
_OF_LIBRARY = frozenset(
    (*(f"{name}{kind}" for name in _OF_MATH.split() for kind in ("", "f", "l")), *_OF_STRING.split())
)
_DECLARED = re.compile(
    r"^(?:[A-Za-z_][^\n(\[=;]*[\s*]|#define\s+)(\w+)", re.MULTILINE
)  # at file scope, as ours is written


def check_name(name: str) -> str:
    """A name that CasADi and C accept; raises ValueError otherwise."""
    if not name.isascii() or not ca.Function.check_name(name) or name in RESERVED_NAMES:
        raise ValueError(
            f"function name {name!r} is not usable, expected letters, digits and single underscores, and no word of C"
        )
    return name


def check_unused(name: str, source: str, *, suffixes: Iterable[str] = ("",)) -> None:
    """ValueError for a name that, with one of these suffixes, a function, an array or a macro of C source has itself,
    or of C's library: it would be declared twice."""
    if {f"{name}{suffix}" for suffix in suffixes} & (_OF_LIBRARY | set(_DECLARED.findall(source))):
        raise ValueError(f"function name {name!r} is not usable, C or the C of contact models has it: choose another")


def _empty(name: str, like: ca.MX) -> ca.MX:
    """CasADi hands a Jacobian also the outputs it belongs to; they are not needed here, so they hold no entries."""
    return ca.MX.sym(name, ca.Sparsity(*like.shape))


def _attached(jacobian: ca.Function) -> dict[str, Any]:
    """Options that make CasADi use a Jacobian for every derivative; never inlined, so that it stays attached."""
    return {"custom_jacobian": jacobian, "jac_penalty": 0, "never_inline": True}


_NO_SEEDS = {"enable_forward": False, "enable_reverse": False}  # not through the graph either


def function_with_derivatives(name: str, pose: ca.MX, outputs: Mapping[str, tuple[ca.MX, ca.MX, ca.MX]]) -> ca.Function:
    """Function pose (6) -> outputs that carries its Jacobian, which in turn carries its own.

    outputs gives by name value (m), Jacobian (m x 6) and second derivatives (m x 36, see `Output`), best as three
    graphs that share nothing that is not needed. Every derivative CasADi asks for, forward or reverse, through
    ``map`` and in nlpsol, is then a product with one of them: no seeds are pushed through the networks.
    """
    check_name(name)
    outs: list[Any] = [_empty(f"out_{key}", value) for key, (value, _, _) in outputs.items()]
    jac_outs: list[Any] = [_empty(f"out_jac_{key}", jacobian) for key, (_, jacobian, _) in outputs.items()]
    out_names = [f"out_{key}" for key in outputs]
    jac_names = [f"jac_{key}_pose" for key in outputs]

    # Jacobian of the Jacobian: a row for each entry of its stacked columns. With (m x 36) stacked by columns of
    # 6 x 6 blocks, that is a relabelling. It does not depend on the empty outputs.
    seconds, second_names = [], []
    for jac_name, (_, jacobian, second) in zip(jac_names, outputs.values(), strict=True):
        seconds.append(ca.reshape(second, jacobian.numel(), 6))
        second_names.append(f"jac_{jac_name}_pose")
        for out, out_name in zip(outs, out_names, strict=True):
            seconds.append(ca.MX(jacobian.numel(), out.numel()))
            second_names.append(f"jac_{jac_name}_{out_name}")
    second_function = ca.Function(
        f"jac_jac_{name}",
        [pose, *outs, *jac_outs],
        seconds,
        ["pose", *out_names, *(f"out_{jac_name}" for jac_name in jac_names)],
        second_names,
    )
    jacobian_function = ca.Function(
        f"jac_{name}",
        [pose, *outs],
        [jacobian for _, jacobian, _ in outputs.values()],
        ["pose", *out_names],
        jac_names,
        _attached(second_function) | _NO_SEEDS,
    )
    values: list[Any] = [value for value, _, _ in outputs.values()]
    options = _attached(jacobian_function)
    graph = ca.Function(name, [pose], values, ["pose"], list(outputs), options | _NO_SEEDS)

    # `Function.factory` differentiates a function's own graph, under that function's options: with the networks in it,
    # or without seeds, that would be slow or fail. This one's graph is a call, which has the Jacobian.
    given = ca.MX.sym("pose", 6)
    return ca.Function(name, [given], graph.call([given]), ["pose"], list(outputs), options)
