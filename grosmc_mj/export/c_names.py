"""Names in C for names of Python: functions of the library, and another name where C takes it."""

from __future__ import annotations

import math
import re
from typing import Any

import numpy as np

# Words of C and of C++, which reads the header too.
_WORDS = """
alignas alignof and and_eq asm auto bitand bitor bool break case catch char class compl const
const_cast constexpr continue decltype default delete do double dynamic_cast else enum explicit
export extern false float for friend goto if inline int long mutable namespace new noexcept not
not_eq nullptr operator or or_eq private protected public register reinterpret_cast restrict
return short signed sizeof static static_assert static_cast struct switch template this
thread_local throw true try typedef typeid typename typeof typeof_unqual union unsigned using
virtual void volatile wchar_t while xor xor_eq
"""
# Macros of the headers, beside those of one form, and names of the exported files themselves.
_MACROS = """
linux unix i386 errno float_t double_t size_t ptrdiff_t
NAN INFINITY HUGE_VAL HUGE_VALF HUGE_VALL OVERFLOW UNDERFLOW DOMAIN SING PLOSS TLOSS NULL
"""
_MACRO = re.compile(r"_?(DBL|FLT|LDBL|FP|M|MATH|U?INT\w*|PTRDIFF|SIZE|SIG|WCHAR|WINT|DECIMAL)_\w*")
_OURS = ("memory", "state", "out", "p")
# Functions of math.h, of which there is one for each type; compilers know them without it, too.
_OF_MATH = """
acos asin atan atan2 cos sin tan cosh sinh tanh acosh asinh atanh exp exp2 exp10 expm1 frexp
ilogb ldexp log log10 log1p log2 logb modf scalb scalbn scalbln cbrt fabs hypot pow pow10 sqrt
erf erfc lgamma gamma tgamma ceil floor nearbyint rint lrint llrint round lround llround trunc
fmod remainder remquo copysign nan nextafter nexttoward fdim fmax fmin fma drem significand j0
j1 jn y0 y1 yn sincos finite cabs carg cimag conj cproj creal
"""
# Other functions that compilers know.
_OF_LIBRARY = """
main isinf isnan isfinite isnormal signbit fpclassify isgreater isless isunordered abs labs
llabs div imaxabs abort exit _Exit atexit malloc calloc realloc free aligned_alloc alloca printf
fprintf sprintf snprintf vprintf vfprintf vsprintf vsnprintf scanf fscanf sscanf vscanf vfscanf
vsscanf puts fputs putchar fputc fputs_unlocked fwrite memchr memcmp memcpy memmove mempcpy
memset bcmp bcopy bzero index rindex strcat strchr strcmp strcpy strcspn strlen strncat strncmp
strncpy strpbrk strrchr strspn strstr strdup strndup stpcpy stpncpy strcasecmp strncasecmp
strnlen isalnum isalpha isascii isblank iscntrl isdigit isgraph islower isprint ispunct isspace
isupper isxdigit toascii tolower toupper ffs ffsl ffsll ffsll execl execlp execle execv execvp
execve fork dcgettext dgettext gettext strfmon strftime matherr signgam
"""
# Helpers and temporaries, escaped names, tables, and types of whole numbers.
_MADE = re.compile(r".*_|.*_v|table_\d+|u?int\w*_t")

_NAMES = {*_WORDS.split(), *_MACROS.split(), *_OURS}
_FUNCTIONS = set(_OF_LIBRARY.split())
for _name in _OF_MATH.split():
    _FUNCTIONS.update((_name, f"{_name}f", f"{_name}l"))

# Pointer to what the law remembers.
MEMORY = "memory"

# Names in C of functions of math, numpy and Python; those with an underscore at their end are in
# ``templates/helpers.c``.
_SAME_NAME = re.findall(
    r"\w+",
    "sqrt sin cos tan asin acos atan atan2 sinh cosh tanh asinh acosh atanh exp expm1 log log1p "
    "log10 log2 fmod copysign fabs isfinite isnan isinf",
)
_OTHER_NAME = {
    "pow": "pow_",
    "arcsin": "asin",
    "arccos": "acos",
    "arctan": "atan",
    "arctan2": "atan2",
    "absolute": "fabs",
    "sign": "sign_",
}
LIBRARY: dict[Any, str] = {abs: "fabs"}
for _module in (math, np):
    for _name, _in_c in {**{name: name for name in _SAME_NAME}, **_OTHER_NAME}.items():
        if hasattr(_module, _name):
            LIBRARY[getattr(_module, _name)] = _in_c

# A variable would hide a function that is called.
_CALLED = {*LIBRARY.values(), "floor", "ceil"}
_CALLED |= {f"{name}f" for name in _CALLED}


def c_name(name: str) -> str:
    """Return a name of Python's as a name of C's; different ones stay different.

    A name that C or this package takes gets ``_v`` at its end, and one that ends so another one.
    """
    letters = [letter if letter.isascii() else f"u{ord(letter):x}" for letter in name]
    ascii_name = "".join(letters)
    taken = _is_taken(ascii_name) or ascii_name in _CALLED
    return f"{ascii_name}_v" if taken or ascii_name != name else ascii_name


def c_function_name(name: str) -> str:
    """Return the name of a function of Python's as the name of one in C."""
    stripped = name.strip("_") if name != "<lambda>" else "value"
    if not stripped or stripped[0].isdigit():
        stripped = f"function_{stripped}".strip("_")
    return f"{stripped}_v" if _is_function(stripped) else c_name(stripped)


def c_prefix(text: str) -> str:
    """Return a text as the begin of names in C, and of files."""
    letters = [letter if letter.isascii() and letter.isalnum() else "_" for letter in text]
    prefix = "".join(letters)
    return prefix if prefix[:1].isalpha() else f"law_{prefix.lstrip('_')}"


def _is_taken(name: str) -> bool:
    """Whether nothing can have a name in C."""
    patterns = (_MACRO, _MADE)
    return name in _NAMES or any(pattern.fullmatch(name) for pattern in patterns)


def _is_function(name: str) -> bool:
    """Whether a name is that of a function of the C library, or of ``main``."""
    return name in _FUNCTIONS
