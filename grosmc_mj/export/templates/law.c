{% import "prototypes.h" as prototypes with context %}
{% for paragraph in law.about %}
{{ paragraph | comment }}
{% endfor %}
#include "{{ law.name }}.h"

#include <float.h>
#include <math.h>
#include <stdint.h>

#ifdef __FAST_MATH__
#error "-ffast-math changes the law: leave it out"
#endif
#if FLT_EVAL_METHOD != 0
#error "numbers must be rounded after every operation: for x86 of 32 bits take -mfpmath=sse"
#endif
#if defined(__GNUC__) && !defined(__clang__)
#pragma GCC optimize("fp-contract=off")
#else
#pragma STDC FP_CONTRACT OFF
#endif

{% if law.numbers.members %}
const struct {{ law.name }}_numbers {{ law.name }}_numbers = {
{{ law.numbers.initial() }}
};

static const struct {{ law.name }}_numbers *const p = &{{ law.name }}_numbers;

{% endif %}
{% set needed %}{% include "helpers.c" %}{% endset %}
{% if needed %}
{{ needed }}
{% endif %}
{{ functions }}
{{ prototypes.init }}
{
    *memory = (struct {{ law.name }}_memory){
{{ law.memory.initial(2) }}
    };
{% for place, state in settled %}
    memory->{{ place }} = start[{{ state }}];
{% endfor %}
{% if law.loop and not settled %}
    (void)start;
{% endif %}
}

{{ prototypes.step }}
{
{% for name in ("t", "x") if not law.loop and name not in step.parameters %}
    (void){{ name }};
{% endfor %}
{% for name in ("clock", "y", "fresh") if law.loop and name not in step.parameters %}
    (void){{ name }};
{% endfor %}
    {{ step.name }}({{ step.arguments | join(", ") }});
{% if not law.loop and "memory->begun" in functions %}
    memory->begun = 1;
{% endif %}
    if ({{ law.undefined }} != 0) {
        return 1;
    }
{% for input in law.system.inputs %}
    if (!isfinite(u[{{ loop.index0 }}])) {
        return 2;
    }
{% endfor %}
    return 0;
}
{% if law.loop %}

{{ prototypes.missed }}
{
    {{ missed.name }}(memory);
}
{% endif %}
