{# Heads of the functions of an exported law. #}
{% set init %}
void {{ law.name }}_init(struct {{ law.name }}_memory *memory
{%- if law.loop %}, const {{ law.real }} start[{{ law.system.states | length }}]{% endif %})
{%- endset %}
{% set step %}
int {{ law.name }}_step(
{%- if law.loop -%}
{{ law.real }} clock, const {{ law.real }} y[{{ law.signals | length }}], const {{ law.real }} fresh[{{ law.signals | length }}],
{%- else -%}
{{ law.real }} t, const {{ law.real }} x[{{ law.signals | length }}],
{%- endif %}

        struct {{ law.name }}_memory *memory, {{ law.real }} u[{{ law.system.inputs | length }}])
{%- endset %}
{% set missed %}
void {{ law.name }}_missed(struct {{ law.name }}_memory *memory)
{%- endset %}
