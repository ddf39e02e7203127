/* {{ law.name }} on a {{ processor.title }}: it answers what the simulation on the host asks. */
#include <fcntl.h>
#include <stdint.h>
#include <unistd.h>

#include "{{ law.name }}.h"

{% set states = law.system.states | length %}
{% set signals = law.signals | length %}
enum {
    SIZE = {{ law.memory.places | length }},
    SIGNALS = {{ signals }},
    INPUTS = {{ law.system.inputs | length }},
    ASKED = {{ asked }},
    ANSWERED = {{ answered }}
};
enum { BEGIN, STEP, MISSED, STACK };

/* All members of a memory are numbers of one type. */
static union memory {
    struct {{ law.name }}_memory of_law;
    {{ law.real }} number[SIZE];
} own;

/* Timer of the core, which counts down. */
#define CONTROL (*(volatile uint32_t *)0xE000E010)
#define RELOAD (*(volatile uint32_t *)0xE000E014)
#define COUNT (*(volatile uint32_t *)0xE000E018)
#define COPROCESSORS (*(volatile uint32_t *)0xE000ED88)
enum { LARGEST_COUNT = 0xFFFFFF };

/* Memory below the stack of main, painted to see how deep the law goes. */
enum { DEPTH = 65536, PAINT = 0x5A };
static volatile unsigned char *top;

extern void _start(void);
extern uint32_t __stack;

void reset(void)
{
    COPROCESSORS |= 0xF << 20;
    __asm volatile("dsb; isb");
    _start();
}

static void stop(void)
{
    for (;;) {
    }
}

__attribute__((section(".vectors"), used)) static void (*const vectors[16])(void) = {
    (void (*)(void))&__stack, reset, stop, stop, stop, stop, stop};

void _init(void) {}
void _fini(void) {}

static __attribute__((noinline)) void paint(void)
{
    volatile unsigned char here = 0;
    top = &here - 64;
    for (int i = 0; i < DEPTH; i++) {
        top[-i] = PAINT;
    }
}

static double stack_used(void)
{
    int i = DEPTH - 1;
    while (i > 0 && top[-i] == PAINT) {
        i--;
    }
    return i;
}

static __attribute__((noinline)) int step(const double *asked, double *answered)
{
    {{ law.real }} signal[2][SIGNALS];
    {{ law.real }} input[INPUTS] = {0};
    for (int i = 0; i < SIGNALS; i++) {
        signal[0][i] = ({{ law.real }})asked[2 + i];
        signal[1][i] = ({{ law.real }})asked[{{ "2 + SIGNALS + i" if law.loop else "2 + i" }}];
    }
    const {{ law.real }} time = ({{ law.real }})asked[1];
    (void)signal[1];
    const uint32_t before = COUNT;
    const int answer = {{ law.name }}_step(time, signal[0], {{ "signal[1], " if law.loop }}&own.of_law, input);
    const uint32_t after = COUNT;
    answered[1] = (double)((before - after) & LARGEST_COUNT);
    for (int i = 0; i < INPUTS; i++) {
        answered[2 + i] = input[i];
    }
    return answer;
}

static void begin(const double *asked)
{
{% if law.loop %}
    {{ law.real }} start[{{ states }}];
    for (int i = 0; i < {{ states }}; i++) {
        start[i] = ({{ law.real }})asked[2 + i];
    }
    {{ law.name }}_init(&own.of_law, start);
{% else %}
    (void)asked;
    {{ law.name }}_init(&own.of_law);
{% endif %}
}

static int transferred(int file, void *buffer, int size, int writes)
{
    char *place = buffer;
    while (size > 0) {
        const int count = writes ? write(file, place, size) : read(file, place, size);
        if (count <= 0) {
            return 0;
        }
        place += count;
        size -= count;
    }
    return 1;
}

int main(void)
{
    static double asked[ASKED], answered[ANSWERED];
    const int in = open("asked", O_RDONLY);
    const int out = open("answered", O_WRONLY);
    RELOAD = LARGEST_COUNT;
    COUNT = 0;
    CONTROL = 5;
    paint();
    while (transferred(in, asked, sizeof asked, 0)) {
        answered[0] = 0;
        switch ((int)asked[0]) {
        case BEGIN:
            begin(asked);
            break;
        case STEP:
            answered[0] = step(asked, answered);
            break;
{% if law.loop %}
        case MISSED:
            {{ law.name }}_missed(&own.of_law);
            break;
{% endif %}
        case STACK:
            answered[0] = stack_used();
            break;
        }
        for (int i = 0; i < SIZE; i++) {
            answered[2 + INPUTS + i] = own.number[i];
        }
        if (!transferred(out, answered, sizeof answered, 1)) {
            break;
        }
    }
    return 0;
}
