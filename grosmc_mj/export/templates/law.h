{% import "prototypes.h" as prototypes with context %}
{% for paragraph in law.about %}
{{ paragraph | comment }}
{% endfor %}
#ifndef {{ law.name | upper }}_H
#define {{ law.name | upper }}_H

{% if law.numbers.members %}
/* Numbers of the law. */
{{ law.numbers.definition }}
extern const struct {{ law.name }}_numbers {{ law.name }}_numbers;

{% endif %}
/* What the law remembers from one sample to the next. */
{{ law.memory.definition }}
{% filter comment %}
Begin a run.
{% if law.loop %}
Estimators that have run before begin with the true state: {{ law.system.states | listed("start") }}.
{% endif %}
{% endfilter %}

{{ prototypes.init }};

{% filter comment %}
One sample, {{ "%g" % law.period }} s after the last one.
{% if law.loop %}
clock: reading of the clock since the first sample, in ticks of {{ "%g" % law.loop.timestep }} s.
{{ law.signals | listed("y") }}: newest measurements.
fresh: how many measurements the sensor has made since the last sample, at most 1 for one without a
period of its own.
{% else %}
t: its time [s]. It reads {{ law.signals | listed("x") }}.
{% endif %}
It writes {{ law.system.inputs | listed("u") }}.
Returns 0, 1 where the law is not defined, 2 where an input is not finite.
{% endfilter %}

{{ prototypes.step }};

{% if law.loop %}
/* The output of the last step was not sent in time, so that the one before is held: call it before
   the next step. */
{{ prototypes.missed }};

{% endif %}
#endif
