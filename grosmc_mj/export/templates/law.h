{% for paragraph in law.about %}
{{ paragraph | comment }}
{% endfor %}
#ifndef {{ law.name | upper }}_H
#define {{ law.name | upper }}_H

/* Numbers of the law. */
{{ law.controller.parameters | definition(law.name ~ "_numbers", law.real) }}
extern const struct {{ law.name }}_numbers {{ law.name }}_numbers;

/* What the law remembers from one sample to the next. */
{{ law.remembered | definition(law.name ~ "_memory", law.real) }}
{% filter comment %}
Begin a run.
{% if law.in_loop %}
Estimators that have run before begin with the true state: {{ law.system.states | listed("start") }}.
{% endif %}
{% endfilter %}

void {{ law.name }}_init(struct {{ law.name }}_memory *memory{{ law.start }});

{% filter comment %}
One sample, {{ "%g" % law.period }} s after the last one. {{ law.about_signals }}
It writes {{ law.system.inputs | listed("u") }}.
Returns 0, 1 where the law is not defined, 2 where an input is not finite.
{% endfilter %}

int {{ law.name }}_step({{ law.signals }},
        struct {{ law.name }}_memory *memory, {{ law.real }} u[{{ law.system.inputs | length }}]);

{% if law.in_loop %}
/* The output of the last step was not sent in time, so that the one before is held: call it before
   the next step. */
void {{ law.name }}_missed(struct {{ law.name }}_memory *memory);

{% endif %}
#endif
