/* lg-control train: what happens if the plant's numbers are not what the controller was trained with. */
#include <math.h>
#include <string.h>

#include "control/policy.h"
#include "lg-control/control_app.h"
#include "machine/internal.h"

/* A number of the machine: known values that change together, or an identified one, a function of theta. */
typedef struct number {
    char name[LG_IDENTIFIED_NAME];
    double *at; /* NULL: identified */
    uint32_t count;
    size_t identified;
    bool lag;
} number;

typedef struct table {
    control_machine *machine;
    number *rows;
    size_t count, identified;
} table;

/* `count`, `k`: the number is entry k of so many with this name. */
static number *add(table *t, const char *name, uint32_t count, uint32_t k) {
    number *row = &t->rows[t->count++];
    *row = (number){.count = 1};
    (void)snprintf(row->name, sizeof row->name, count == 1 ? "%s" : "%s.%u", name, k + 1);
    row->lag = strncmp(name, "lag", 3) == 0 || strncmp(name, "second_order_lag", 16) == 0;
    return row;
}

/* The known values of a term; a matrix of the velocities with numbers off its diagonal changes as a whole. */
static void add_term(table *t, lg_machine_term *term) {
    const uint32_t n = t->machine->machine.velocities, count = term->value_count;
    const char *kind = lg_term_kind_name(term->kind);
    const char *name = strcmp(kind, "known") == 0 ? lg_machine_part_name(term->part) : kind;
    bool whole = count == n * n && n > 1;
    for (uint32_t k = 0; whole && k < count; k++) whole = !lg_machine_is_entry_of(term, k);
    for (uint32_t k = 0; k < count && !(whole && k > 0); k++) {
        if (!whole && (term->values[k] == 0 || lg_machine_is_entry_of(term, k))) continue;
        number *row = add(t, name, whole ? 1 : count, k);
        row->at = &term->values[k], row->count = whole ? count : 1;
    }
}

static void list_numbers(table *t) {
    lg_machine *machine = &t->machine->machine;
    const double *theta = t->machine->model.theta;
    uint32_t at = 0;
    t->identified = theta != NULL ? lg_machine_numbers(machine, theta, 0, NULL) : 0;
    t->rows = app_keep(LG_MACHINE_PARAMETERS + LG_MACHINE_TERMS * (LG_MACHINE_VALUES + 1) + t->identified,
                       sizeof *t->rows);
    const lg_parameter_entry *entry = machine->grey.system != NULL ? machine->grey.system->parameters : NULL;
    for (; entry != NULL && entry->key != NULL; entry++) {
        const uint32_t count = entry->count > 0 ? (uint32_t)entry->count : machine->coordinate_count;
        for (uint32_t k = 0; k < count && at < machine->grey.count; k++, at++) {
            if (machine->grey.unknown[at] || machine->grey.start[at] == 0) continue;
            add(t, entry->key, count, k)->at = &machine->grey.start[at];
        }
    }
    for (uint32_t i = 0; i < machine->term_count; i++) add_term(t, &machine->terms[i]);
    APP_FREE lg_identified *found = app_alloc(t->identified + 1, sizeof *found);
    if (t->identified > 0) (void)lg_machine_numbers(machine, theta, t->identified, found);
    for (size_t k = 0; k < t->identified; k++)
        if (found[k].value != 0 && isfinite(found[k].value)) add(t, found[k].name, 1, 0)->identified = k;
}

/* ---- changes ---- */

static double value_of(const table *t, size_t index) {
    APP_FREE lg_identified *found = app_alloc(t->identified, sizeof *found);
    (void)lg_machine_numbers(&t->machine->machine, t->machine->model.theta, t->identified, found);
    return found[index].value;
}

/* Changes the entry of theta that the number depends on most, by the secant method. */
static bool change_identified(const table *t, size_t index, double factor) {
    static const double step = 1e-4;
    const lg_machine *machine = &t->machine->machine;
    double *theta = t->machine->model.theta, most = 0, was = value_of(t, index), now = was;
    size_t best = 0;
    const double wanted = factor * was;
    for (size_t i = machine->weights; i < machine->parameters; i++) {
        theta[i] += step;
        const double slope = fabs(value_of(t, index) - was);
        theta[i] -= step;
        if (slope > most) most = slope, best = i;
    }
    double by = step;
    for (int k = 0; k < 50 && most > 0 && fabs(now - wanted) > 1e-9 * fabs(wanted); k++) {
        theta[best] += by;
        now = value_of(t, index);
        if (now == was || !isfinite(now)) return false;
        by *= (wanted - now) / (now - was);
        was = now;
    }
    return fabs(now - wanted) <= 1e-6 * fabs(wanted);
}

/* The success on the plant as it is now; NaN: it could not be simulated. */
static double success_of(const table *t, const lg_policy *policy, uint64_t starts) {
    const control_machine *m = t->machine;
    const app *self = m->self;
    lg_policy *other = NULL;
    lg_policy_outcome outcome;
    lg_program *plant = NULL;
    const bool lagged = policy->memory.lags > 0;
    lg_status status =
        lg_machine_program(self->context, &m->machine, m->model.theta, m->scheme, lagged, &plant, NULL);
    if (status == LG_OK) status = lg_policy_transplant(policy, plant, NULL, &other, NULL);
    if (status == LG_OK)
        status = lg_policy_evaluate(other, LG_POLICY_NOMINAL, starts, self->seed, (int)self->threads,
                                    &outcome, NULL, NULL);
    lg_policy_destroy(other);
    return status == LG_OK ? (double)outcome.succeeded / (double)outcome.starts : NAN;
}

static double changed_success(const table *t, const number *row, double factor, const lg_policy *policy,
                              uint64_t starts) {
    control_machine *m = t->machine;
    const size_t n = m->model.parameters;
    APP_FREE lg_machine *machine = app_alloc(1, sizeof *machine);
    APP_FREE double *theta = app_alloc(n + 1, sizeof *theta);
    *machine = m->machine;
    if (n > 0) memcpy(theta, m->model.theta, n * sizeof *theta);
    for (uint32_t k = 0; row->at != NULL && k < row->count; k++) row->at[k] *= factor;
    const bool good = row->at != NULL || change_identified(t, row->identified, factor);
    const double success = good ? success_of(t, policy, starts) : NAN;
    m->machine = *machine;
    if (n > 0) memcpy(m->model.theta, theta, n * sizeof *theta);
    return success;
}

void control_tell_robustness(const lg_policy *policy, control_machine *machine, uint64_t starts,
                             app_json *out) {
    static const double usual[] = {0.8, 0.9, 1.1, 1.2, 4.0 / 3, 5.0 / 3}; /* the last two of lags */
    table t = {.machine = machine};
    if (starts > 0 && machine->scheme != NULL) list_numbers(&t);
    if (t.count > 0)
        app_result_line(out, "from %llu starts, if a number of the plant is off by a factor:",
                        (unsigned long long)starts);
    app_result_rows(out, "robustness");
    for (size_t i = 0; i < t.count; i++)
        for (size_t k = 0; k < LG_COUNT(usual) - (t.rows[i].lag ? 0 : 2); k++)
            APP_OBJECT(out, NULL, LG_AS_TEXT("name", t.rows[i].name), LG_AS_REAL("factor", usual[k]),
                       LG_AS_REAL("success", changed_success(&t, &t.rows[i], usual[k], policy, starts)));
    app_result_rows_end(out);
}
