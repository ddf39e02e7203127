"""Names that C, its library and the exported files take: names of Python's are others in C."""

from __future__ import annotations

import re

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


def is_taken(name: str) -> bool:
    """Whether nothing can have a name in C."""
    patterns = (_MACRO, _MADE)
    return name in _NAMES or any(pattern.fullmatch(name) for pattern in patterns)


def is_function(name: str) -> bool:
    """Whether a name is that of a function of the C library, or of ``main``."""
    return name in _FUNCTIONS
