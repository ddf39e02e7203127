/* {{ law.name }} with memory and signals in double precision, as simulations have them. */
#include "{{ law.name }}.h"

{% set states = law.system.states | length %}
enum { SIZE = {{ law.memory.places | length }}, SIGNALS = {{ law.signals | length }}, INPUTS = {{ law.system.inputs | length }} };

/* Where the numbers of the memory stand in that of the Python law. */
static const int place[SIZE] = { {{ law.memory.places | join(", ") }} };

/* All members of a memory are numbers of one type. */
union memory {
    struct {{ law.name }}_memory of_law;
    {{ law.real }} number[SIZE];
};

static void load(union memory *own, const double *memory)
{
    for (int i = 0; i < SIZE; i++) {
        own->number[i] = ({{ law.real }})memory[i];
    }
}

static void store(const union memory *own, double *memory)
{
    for (int i = 0; i < SIZE; i++) {
        memory[i] = own->number[i];
    }
}

void begin_of_doubles(double *memory, const double *start)
{
    union memory own;
{% if law.loop %}
    {{ law.real }} state[{{ states }}];
    for (int i = 0; i < {{ states }}; i++) {
        state[i] = ({{ law.real }})start[i];
    }
    {{ law.name }}_init(&own.of_law, state);
{% else %}
    (void)start;
    {{ law.name }}_init(&own.of_law);
{% endif %}
    store(&own, memory);
}

int step_of_doubles(double time, const double *x, const double *fresh, double *memory, double *u)
{
    {{ law.real }} signals[2][SIGNALS];
    {{ law.real }} input[INPUTS] = {0};
    union memory own;
    for (int i = 0; i < SIGNALS; i++) {
        signals[0][i] = ({{ law.real }})x[i];
        signals[1][i] = ({{ law.real }})fresh[i];
    }
    load(&own, memory);
    const int answer = {{ law.name }}_step(({{ law.real }})time, signals[0],
            {{ "signals[1], " if law.loop }}&own.of_law, input);
    store(&own, memory);
    for (int i = 0; i < INPUTS; i++) {
        u[i] = input[i];
    }
    return answer;
}

/* One sample of a run, whose memory stands behind a mark that the run has begun and the answer of
   the step; the memory of the Python law shows it. */
void sample_of_doubles(double t, const double *x, double *run, double *u, double *shown)
{
    if (run[0] == 0) {
        begin_of_doubles(run + 2, x);
        run[0] = 1;
    }
    run[1] = step_of_doubles(t, x, x, run + 2, u);
    for (int i = 0; i < SIZE; i++) {
        shown[place[i]] = run[2 + i];
    }
}
{% if law.loop %}

void missed_of_doubles(double *memory)
{
    union memory own;
    load(&own, memory);
    {{ law.name }}_missed(&own.of_law);
    store(&own, memory);
}
{% endif %}
