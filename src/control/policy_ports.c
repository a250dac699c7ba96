/* Ports of the functions of a policy's program. */
#include <math.h>
#include <string.h>

#include "control/policy.h"

/* Returns the port that rows call `name`, such as "small z", a port z with small numbers. */
static lg_port port_of(const lg_policy *p, const char *name) {
    double far = 0.0;
    for (uint32_t l = 0; l < p->inputs; l++)
        far = fmax(far, fmax(fabs(p->task.input[l].low), fabs(p->task.input[l].high)));
    const lg_policy_layout *l = &p->layout;
    const uint32_t m = p->inputs,
                   references = lg_policy_tracked(&p->task) * (p->layout.velocities > 0 ? 2 : 1);
    size_t function, count;
    lg_port x = {0}, lagged = {0};
    if (lg_program_find(p->program, "step", &function, NULL) == LG_OK)
        x = lg_program_inputs(p->program, function, &count)[0];
    if (lg_program_find(p->program, "lag", &function, NULL) == LG_OK)
        lagged = lg_program_inputs(p->program, function, &count)[0];
    x.name = "x";
    const struct {
        const char *name;
        lg_port port;
    } all[] = {{"x", x},
               {"lagged", lagged},
               {"u", {"u", lg_shape1(m), .low = -far, .high = far}},
               {"unit u", {"u", lg_shape1(m), .low = -1, .high = 1}},
               {"acting", {"u", lg_shape1(m + p->memory.count), .low = 0}},
               {"small z", {"z", lg_shape1(l->errors), .low = -0.1, .high = 0.1}},
               {"z", {"z", lg_shape1(l->errors), .low = 0}},
               {"one z", {"z", lg_shape1(1), .low = 0}},
               {"q", {"q", lg_shape1(l->positions), .low = -1, .high = 1}},
               {"v", {"v", lg_shape1(l->velocities), .low = -1, .high = 1}},
               {"weights", {"weights", lg_shape1((uint32_t)p->parameters), .shared = true}},
               {"given", {"x", lg_shape1(l->given + l->velocities), .low = -1, .high = 1}},
               {"K", {"K", lg_shape2(m, l->errors), .shared = true}},
               {"s", {"s", lg_shape1(p->state + m), .low = x.low, .high = x.high}},
               {"noise", {"noise", lg_shape1(l->noise), .low = -0.1, .high = 0.1}},
               {"late", {"late", lg_shape1(1), .low = 0, .high = 1}},
               {"measured", {"seen", lg_shape1(2 * l->given), .low = 0}},
               {"estimate", {"memory", lg_shape1(2 * l->given * (2 * l->given + 1)), .low = 0}},
               {"next", {"next", lg_shape1(l->given + l->velocities), .low = -1, .high = 1}},
               {"found", {"memory", lg_shape1(LG_POLICY_ADAPT * l->velocities), .low = 0}},
               {"reference", {"reference", lg_shape1(references), .low = -1, .high = 1}},
               {"y", {"y", lg_shape1(m), .low = -1, .high = 1}},
               {"how", {"how", lg_shape1(LG_POLICY_PLANNED), .low = 0, .high = 1}}};
    size_t i = 0;
    while (strcmp(all[i].name, name) != 0) i++;
    return all[i].port;
}

lg_status lg_policy_add_row_with(const lg_policy *p, const lg_policy_function *row, const void *user,
                                 lg_error *error) {
    lg_port in[4], out[3] = {{0}};
    size_t ins = 0, outs = 0;
    for (int k = 0; row->in[k] != NULL; k++) {
        in[ins] = port_of(p, row->in[k]);
        ins += lg_shape_count(in[ins].shape) > 0;
    }
    for (; row->out[outs] != NULL; outs++) out[outs].name = row->out[outs];
    const lg_function_spec spec = {row->name, in, ins, out, outs, row->record, (void *)(uintptr_t)user};
    return lg_program_add_function(p->program, &spec, error);
}

lg_status lg_policy_add_row(const lg_policy *p, const lg_policy_function *row, lg_error *error) {
    return lg_policy_add_row_with(p, row, p, error);
}
