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

const struct {{ law.name }}_numbers {{ law.name }}_numbers = {
{{ law.controller.parameters | initial(law.suffix) }}
};

{% if "p->" in law.functions %}
static const struct {{ law.name }}_numbers *const p = &{{ law.name }}_numbers;

{% endif %}
{{ law.functions }}
void {{ law.name }}_init(struct {{ law.name }}_memory *memory{{ law.start }})
{
    *memory = (struct {{ law.name }}_memory){
{{ law.remembered | initial(law.suffix, 2) }}
    };
{% for line in law.settled %}
    {{ line }}
{% endfor %}
}

int {{ law.name }}_step({{ law.signals }},
        struct {{ law.name }}_memory *memory, {{ law.real }} u[{{ law.system.inputs | length }}])
{
{% for line in law.sample %}
    {{ line }}
{% endfor %}
    if ({{ law.place }}undefined != 0) {
        return 1;
    }
{% for input in law.system.inputs %}
    if (!isfinite(u[{{ loop.index0 }}])) {
        return 2;
    }
{% endfor %}
    return 0;
}
{% if law.in_loop %}

void {{ law.name }}_missed(struct {{ law.name }}_memory *memory)
{
    {{ law.missed.name }}(memory);
}
{% endif %}
