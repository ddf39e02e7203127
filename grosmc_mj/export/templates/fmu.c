/* {{ law.name }} as an FMU for co-simulation, FMI 2.0. */
#include <string.h>

#include "fmi2Functions.h"

#include "{{ law.name }}.h"

enum { SETTABLE = {{ variables | length - law.system.inputs | length }}, VARIABLES = {{ variables | length }} };

/* The law is sampled at the begin of each control period [s], and its output is held. */
static const fmi2Real period = {{ law.period }};

/* Inputs, parameters and outputs before anything is set. */
static const {{ law.real }} start[VARIABLES] = {
        {{ variables | map(attribute="start") | join(", ") }}};

struct instance {
    const fmi2CallbackFunctions *functions;
    fmi2Real begin; /* time at which the simulation begins [s] */
    fmi2Real k;     /* number of the next sample */
    {{ law.real }} value[VARIABLES];
    struct {{ law.name }}_memory memory;
};

static void begin_run(struct instance *me)
{
    me->k = 0;
    {{ law.name }}_init(&me->memory{{ ", me->value + %d" % (2 * law.signals | length) if law.loop }});
}

static int sample(struct instance *me)
{
{% if law.loop %}
    return {{ law.name }}_step(({{ law.real }})(me->k * {{ (law.period / law.loop.timestep) | round | int }}), me->value, me->value + {{ law.signals | length }},
            &me->memory, me->value + SETTABLE);
{% else %}
    const fmi2Real t = me->begin + me->k * period;
    return {{ law.name }}_step(({{ law.real }})t, me->value, &me->memory, me->value + SETTABLE);
{% endif %}
}

fmi2Component fmi2Instantiate(fmi2String name, fmi2Type type, fmi2String guid, fmi2String resources,
        const fmi2CallbackFunctions *functions, fmi2Boolean visible, fmi2Boolean logs)
{
    (void)name, (void)resources, (void)visible, (void)logs;
    if (type != fmi2CoSimulation || strcmp(guid, "{{ guid }}") != 0) {
        return NULL;
    }
    struct instance *me = functions->allocateMemory(1, sizeof *me);
    if (me != NULL) {
        me->functions = functions;
        memcpy(me->value, start, sizeof start);
    }
    return me;
}

void fmi2FreeInstance(fmi2Component c)
{
    struct instance *me = c;
    if (me != NULL) {
        me->functions->freeMemory(me);
    }
}

fmi2Status fmi2SetupExperiment(fmi2Component c, fmi2Boolean has_tolerance, fmi2Real tolerance,
        fmi2Real begin, fmi2Boolean has_end, fmi2Real end)
{
    struct instance *me = c;
    (void)has_tolerance, (void)tolerance, (void)has_end, (void)end;
    me->begin = begin;
    return fmi2OK;
}

/* Its parameters are known now. */
fmi2Status fmi2ExitInitializationMode(fmi2Component c)
{
    begin_run(c);
    return fmi2OK;
}

/* Gives the instance its start values; the next initialization begins the memory. */
fmi2Status fmi2Reset(fmi2Component c)
{
    struct instance *me = c;
    memcpy(me->value, start, sizeof start);
    return fmi2OK;
}

fmi2Status fmi2GetReal(fmi2Component c, const fmi2ValueReference which[], size_t n, fmi2Real to[])
{
    const struct instance *me = c;
    for (size_t i = 0; i < n; i++) {
        if (which[i] >= VARIABLES) {
            return fmi2Error;
        }
        to[i] = me->value[which[i]];
    }
    return fmi2OK;
}

fmi2Status fmi2SetReal(fmi2Component c, const fmi2ValueReference which[], size_t n,
        const fmi2Real from[])
{
    struct instance *me = c;
    for (size_t i = 0; i < n; i++) {
        if (which[i] >= SETTABLE) {
            return fmi2Error;
        }
        me->value[which[i]] = ({{ law.real }})from[i];
    }
    return fmi2OK;
}

/* Take the samples that are due before the step ends, with the inputs that were set last. */
fmi2Status fmi2DoStep(fmi2Component c, fmi2Real t, fmi2Real h, fmi2Boolean no_return)
{
    struct instance *me = c;
    (void)no_return;
    while (me->begin + me->k * period < t + h - 1e-6 * period) {
        const int answer = sample(me);
        me->k += 1;
        if (answer != 0) {
            me->functions->logger(me->functions->componentEnvironment, "{{ law.name }}", fmi2Error, "error",
                answer == 1 ? "the law is not defined here" : "an input of the plant is not finite");
            return fmi2Error;
        }
    }
    return fmi2OK;
}

const char *fmi2GetTypesPlatform(void) { return fmi2TypesPlatform; }
const char *fmi2GetVersion(void) { return fmi2Version; }

/* Nothing to do, or nothing that the model description promises. */
#define ARRAY(type) fmi2Component c, const fmi2ValueReference r[], size_t n, type v[]
#define ANSWER(status, name, ...) fmi2Status name(__VA_ARGS__) { return status; }
#pragma GCC diagnostic ignored "-Wunused-parameter"
ANSWER(fmi2OK, fmi2SetDebugLogging, fmi2Component c, fmi2Boolean on, size_t n, const fmi2String k[])
ANSWER(fmi2OK, fmi2EnterInitializationMode, fmi2Component c)
ANSWER(fmi2OK, fmi2Terminate, fmi2Component c)
ANSWER(fmi2Error, fmi2GetInteger, ARRAY(fmi2Integer))
ANSWER(fmi2Error, fmi2GetBoolean, ARRAY(fmi2Boolean))
ANSWER(fmi2Error, fmi2GetString, ARRAY(fmi2String))
ANSWER(fmi2Error, fmi2SetInteger, ARRAY(const fmi2Integer))
ANSWER(fmi2Error, fmi2SetBoolean, ARRAY(const fmi2Boolean))
ANSWER(fmi2Error, fmi2SetString, ARRAY(const fmi2String))
ANSWER(fmi2Error, fmi2GetFMUstate, fmi2Component c, fmi2FMUstate *s)
ANSWER(fmi2Error, fmi2SetFMUstate, fmi2Component c, fmi2FMUstate s)
ANSWER(fmi2Error, fmi2FreeFMUstate, fmi2Component c, fmi2FMUstate *s)
ANSWER(fmi2Error, fmi2SerializedFMUstateSize, fmi2Component c, fmi2FMUstate s, size_t *n)
ANSWER(fmi2Error, fmi2SerializeFMUstate, fmi2Component c, fmi2FMUstate s, fmi2Byte b[], size_t n)
ANSWER(fmi2Error, fmi2DeSerializeFMUstate, fmi2Component c, const fmi2Byte b[], size_t n, fmi2FMUstate *s)
ANSWER(fmi2Error, fmi2GetDirectionalDerivative, fmi2Component c, const fmi2ValueReference a[], size_t n,
       const fmi2ValueReference b[], size_t m, const fmi2Real d[], fmi2Real e[])
ANSWER(fmi2Error, fmi2SetRealInputDerivatives, fmi2Component c, const fmi2ValueReference r[], size_t n,
       const fmi2Integer o[], const fmi2Real v[])
ANSWER(fmi2Error, fmi2GetRealOutputDerivatives, fmi2Component c, const fmi2ValueReference r[], size_t n,
       const fmi2Integer o[], fmi2Real v[])
ANSWER(fmi2Error, fmi2CancelStep, fmi2Component c)
ANSWER(fmi2Error, fmi2GetStatus, fmi2Component c, const fmi2StatusKind k, fmi2Status *v)
ANSWER(fmi2Error, fmi2GetRealStatus, fmi2Component c, const fmi2StatusKind k, fmi2Real *v)
ANSWER(fmi2Error, fmi2GetIntegerStatus, fmi2Component c, const fmi2StatusKind k, fmi2Integer *v)
ANSWER(fmi2Error, fmi2GetBooleanStatus, fmi2Component c, const fmi2StatusKind k, fmi2Boolean *v)
ANSWER(fmi2Error, fmi2GetStringStatus, fmi2Component c, const fmi2StatusKind k, fmi2String *v)
