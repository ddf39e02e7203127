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
{# A volatile exponent, or the compiler would take products, which round otherwise. #}
{% if functions is calling("pow_") %}
static inline {{ real }} pow_({{ real }} a, {{ real }} b) { volatile {{ real }} e = b; return pow{{ "f" if real == "float" }}(a, e); }
{% endif %}
{% for table in tables if functions is mentioning(table.name) %}
{{ "static const %s %s[%d] = {%s};" | format(law.real, table.name, table.entries | length, table.entries | join(", ")) | wrapped(0, 4) | join("\n") }}
{% endfor %}
