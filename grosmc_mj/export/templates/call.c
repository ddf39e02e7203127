/* {{ law.name }} with memory and signals in double precision, as simulations have them. */
#include "{{ law.name }}.h"

enum { SIZE = {{ law.memory_size }}, SIGNALS = {{ law.signals | length }}, INPUTS = {{ law.system.inputs | length }} };

/* All members of a memory are numbers of one type. */
union memory {
    struct {{ law.name }}_memory of_law;
    {{ law.real }} number[SIZE];
};

int step_of_doubles(double time, const double *x, const double *fresh, double *memory, double *u)
{
    {{ law.real }} signals[2][SIGNALS];
    {{ law.real }} input[INPUTS] = {0};
    union memory own;
    for (int i = 0; i < SIGNALS; i++) {
        signals[0][i] = ({{ law.real }})x[i];
        signals[1][i] = ({{ law.real }})fresh[i];
    }
    for (int i = 0; i < SIZE; i++) {
        own.number[i] = ({{ law.real }})memory[i];
    }
    const int answer = {{ law.name }}_step(({{ law.real }})time, signals[0],
            {{ "signals[1], " if law.loop }}&own.of_law, input);
    for (int i = 0; i < SIZE; i++) {
        memory[i] = own.number[i];
    }
    for (int i = 0; i < INPUTS; i++) {
        u[i] = input[i];
    }
    return answer;
}

int law_of_doubles(double t, const double *x, double *memory, double *u)
{
    return step_of_doubles(t, x, x, memory, u);
}
{% if law.loop %}

void begin_of_doubles(double *memory, const double *start)
{
    {{ law.real }} state[{{ law.system.states | length }}];
    union memory own;
    for (int i = 0; i < {{ law.system.states | length }}; i++) {
        state[i] = ({{ law.real }})start[i];
    }
    {{ law.name }}_init(&own.of_law, state);
    for (int i = 0; i < SIZE; i++) {
        memory[i] = own.number[i];
    }
}

void missed_of_doubles(double *memory)
{
    union memory own;
    for (int i = 0; i < SIZE; i++) {
        own.number[i] = ({{ law.real }})memory[i];
    }
    {{ law.name }}_missed(&own.of_law);
    for (int i = 0; i < SIZE; i++) {
        memory[i] = own.number[i];
    }
}
{% endif %}
