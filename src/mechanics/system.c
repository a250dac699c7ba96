/* Systems: making them, asking them, and the table. */
#include "mechanics/system.h"

#include <math.h>
#include <stdio.h>
#include <string.h>

static const lg_system_row *const rows[] = {&lg_system_row_chain, &lg_system_row_quartic,
                                            &lg_system_row_coupled};

const char *lg_system_name_at(size_t index) {
    return index < LG_COUNT(rows) ? rows[index]->name : NULL;
}

void lg_system_options_init(lg_system_options *options) {
    *options = (lg_system_options){.size = sizeof(lg_system_options), .links = 1, .gravity = 1.0};
}

static const lg_system_row *find_row(const char *name) {
    for (size_t i = 0; name && i < LG_COUNT(rows); i++)
        if (strcmp(rows[i]->name, name) == 0) return rows[i];
    return NULL;
}

static lg_status check_positive(const double *x, size_t n, const char *what, lg_error *error) {
    for (size_t i = 0; x && i < n; i++)
        if (!(x[i] > 0.0) || !isfinite(x[i]))
            return lg_fail(error, LG_INVALID_ARGUMENT, "%s[%zu] = %g is not a positive number", what, i,
                           x[i]);
    return LG_OK;
}

#define LINKS_MAX 1000000

static lg_status check_options(const lg_system_row *row, const lg_system_options *options, lg_error *error) {
    if (options->size != sizeof(lg_system_options))
        return lg_fail(error, LG_INVALID_ARGUMENT, "system options of unknown size %zu", options->size);
    if (row->copies > 0) return LG_OK;
    if (options->links < 1 || options->links > LINKS_MAX)
        return lg_fail(error, LG_INVALID_ARGUMENT, "links = %zu is outside 1..%d", options->links, LINKS_MAX);
    if (!isfinite(options->gravity))
        return lg_fail(error, LG_INVALID_ARGUMENT, "gravity = %g is not finite", options->gravity);
    LG_TRY(check_positive(options->masses, options->links, "masses", error));
    return check_positive(options->lengths, options->links, "lengths", error);
}

#define LAYOUT_CHARACTERS 20 /* a link, " q1000000 p1000000" */

static void write_layout(char *text, size_t links) {
    for (size_t i = 1; i <= links; i++) text += sprintf(text, "%sq%zu p%zu", i > 1 ? " " : "", i, i);
}

/* One block: the structure, the chain's numbers, the text of the layout. */
lg_status lg_system_create(const lg_context *context, const char *name, const lg_system_options *options,
                           lg_system **out, lg_error *error) {
    lg_system_options defaults;
    lg_system_options_init(&defaults);
    if (!options) options = &defaults;
    if (!out) return lg_fail(error, LG_INVALID_ARGUMENT, "out is NULL");
    const lg_system_row *row = find_row(name);
    if (!row) return lg_fail(error, LG_NOT_FOUND, "there is no system \"%s\"", name ? name : "(null)");
    LG_TRY(check_options(row, options, error));
    const size_t k = row->copies > 0 ? 0 : options->links;
    const size_t head = (sizeof(lg_system) + sizeof(double) - 1) / sizeof(double);
    lg_system *system = lg_alloc(context, (head + 6 * k) * sizeof(double) + k * LAYOUT_CHARACTERS + 8, 1);
    if (!system) return lg_fail(error, LG_OUT_OF_MEMORY, "no memory for %s", row->name);
    double *numbers = (double *)system + head;
    system->row = row;
    system->layout = (char *)(numbers + 6 * k);
    (void)lg_space_init(&system->space, &(lg_space_factor){row->kind, k > 0 ? k : row->copies}, 1);
    if (k > 0) {
        system->chain = (lg_chain){
            k, numbers, numbers + k, numbers + 2 * k, numbers + 3 * k, numbers + 4 * k, numbers + 5 * k};
        lg_chain_fill(&system->chain, options->gravity, options->masses, options->lengths);
        write_layout(system->layout, k);
    }
    *out = system;
    return lg_fail(error, LG_OK, "%s", "");
}

void lg_system_destroy(const lg_context *context, lg_system *system) {
    lg_free(context, system);
}

const char *lg_system_name(const lg_system *system) {
    return system->row->name;
}

const char *lg_system_layout(const lg_system *system) {
    return system->row->layout ? system->row->layout : system->layout;
}

size_t lg_system_dim(const lg_system *system) {
    return system->space.dim;
}

size_t lg_system_links(const lg_system *system) {
    return system->chain.links;
}

bool lg_system_constrained(const lg_system *system) {
    return !lg_space_is_abelian(&system->space);
}

bool lg_system_separable(const lg_system *system) {
    return system->row->separable;
}

size_t lg_system_workspace(const lg_system *system) {
    const size_t work = system->row->work * system->space.factor[0].count;
    return work > 0 ? work : 1;
}

double lg_system_hamiltonian(const lg_system *system, const double *y, double *work) {
    return system->row->hamiltonian(system, y, work);
}

size_t lg_system_invariants(const lg_system *system) {
    size_t n = 1;
    while (system->row->invariants[n - 1]) n++;
    return n;
}

const char *lg_system_invariant_name(const lg_system *system, size_t index) {
    if (index == 0) return "energy";
    return index < lg_system_invariants(system) ? system->row->invariants[index - 1] : NULL;
}

double lg_system_invariant(const lg_system *system, size_t index, const double *y, double *work) {
    if (index == 0) return lg_system_hamiltonian(system, y, work);
    return index < lg_system_invariants(system) ? system->row->invariant(system, index - 1, y) : NAN;
}

lg_form lg_system_form_for(const lg_scheme *scheme) {
    return scheme->ambient || scheme->kind == LG_SCHEME_SPLITTING ? LG_FORM_AMBIENT : LG_FORM_LIE;
}

lg_status lg_system_ode(const lg_system *system, lg_form form, lg_system_user *user, double *work,
                        lg_ode *ode) {
    if (!system || !user || !work || !ode || (unsigned)form > LG_FORM_AMBIENT) return LG_INVALID_ARGUMENT;
    lg_ode result = {.space = system->space,
                     .field = system->row->field[form],
                     .force = system->row->force,
                     .velocity = system->row->velocity,
                     .user = user};
    if (form == LG_FORM_AMBIENT) LG_TRY(lg_space_init_rn(&result.space, system->space.dim));
    *user = (lg_system_user){system, work};
    *ode = result;
    return LG_OK;
}
