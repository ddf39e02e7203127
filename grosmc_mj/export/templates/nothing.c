/* Functions of {{ law.name }} that do nothing: their size is that of the program without the law. */
{% import "prototypes.h" as prototypes with context %}
#include "{{ law.name }}.h"

{{ prototypes.init }}
{
    memory->{{ law.undefined.removeprefix("memory->") }} = 0;
{% if law.loop %}
    (void)start;
{% endif %}
}

{{ prototypes.step }}
{
    (void){{ "clock, (void)y, (void)fresh" if law.loop else "t, (void)x" }};
    u[0] = memory->{{ law.undefined.removeprefix("memory->") }};
    return 0;
}
{% if law.loop %}

{{ prototypes.missed }}
{
    (void)memory;
}
{% endif %}
