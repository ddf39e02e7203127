{# Functions that the C library lacks and tables, as far as the functions of the law need them. #}
{% set real = law.real %}
{% if functions is calling("min_") %}
static inline {{ real }} min_({{ real }} a, {{ real }} b) { return b < a ? b : a; }
{% endif %}
{% if functions is calling("max_") %}
static inline {{ real }} max_({{ real }} a, {{ real }} b) { return b > a ? b : a; }
{% endif %}
{% if functions is calling("least_") %}
static inline int64_t least_(int64_t a, int64_t b) { return b < a ? b : a; }
{% endif %}
{% if functions is calling("most_") %}
static inline int64_t most_(int64_t a, int64_t b) { return b > a ? b : a; }
{% endif %}
{% if functions is calling("sign_") %}
static inline {{ real }} sign_({{ real }} a) { return a > 0 ? 1 : a < 0 ? -1 : a == 0 ? 0 : a; }
{% endif %}
{% if functions is calling("mod_") %}
static inline int64_t mod_(int64_t a, int64_t b) { return (a % b + b) % b; }
{% endif %}
{# A number that int64_t has; elsewhere its least one, and the law is not defined. #}
{% if functions is calling("whole_") %}
static inline int64_t whole_({{ real }} a, {{ real }} *undefined)
{
    if (a >= -0x1p63{{ "f" if real == "float" }} && a < 0x1p63{{ "f" if real == "float" }}) {
        return (int64_t)a;
    }
    *undefined = 1;
    return INT64_MIN;
}
{% endif %}
{# Volatile, or a compiler would take products, exp2 or exp10, which round otherwise. #}
{% if functions is calling("pow_") %}
static inline {{ real }} pow_({{ real }} a, {{ real }} b) { volatile {{ real }} c = a, e = b; return pow{{ "f" if real == "float" }}(c, e); }
{% endif %}
{% for table in tables if functions is mentioning(table.name) %}
{{ "static const %s %s[%d] = {%s};" | format(law.real, table.name, table.entries | length, table.entries | join(", ")) | wrapped(0, 4) | join("\n") }}
{% endfor %}
