/* Systems: the table, construction and queries. */
#include "mechanics/system.h"

#include <math.h>
#include <stdio.h>
#include <string.h>

#include "mechanics/engine.h"

/* ---- the tables ---- */

#define ROW(name)    &lg_system_row_##name,
#define ENERGY(name) &lg_energy_##name,
static const lg_system_row *const rows[] = {LG_SYSTEM_ROWS(ROW)};
const lg_energy_row *const lg_energy_rows[] = {LG_ENERGIES(ENERGY) NULL};

/* Row `index`; NULL beyond the last. */
static const lg_system_row *row_at(size_t index) {
    return index < LG_COUNT(rows) ? rows[index] : lg_derived_row(index - LG_COUNT(rows));
}

bool lg_system_at(size_t index, const char **name, const char **form) {
    const lg_system_row *row = row_at(index);
    if (row && name) *name = row->name;
    if (row && form) *form = row->form;
    return row != NULL;
}

static bool same(const char *a, const char *b) {
    return a && b && strcmp(a, b) == 0;
}

/* If `form` is NULL, the first row with this name. */
static const lg_system_row *find_row(const char *name, const char *form) {
    const lg_system_row *row;
    for (size_t i = 0; (row = row_at(i)) != NULL; i++)
        if (same(row->name, name) && (!form || same(row->form, form))) break;
    return row;
}

const lg_parameter_entry *lg_system_parameters(const char *name, const char *form) {
    const lg_system_row *row = find_row(name, form);
    return row ? row->parameters : NULL;
}

const lg_state_entry *lg_system_state(const char *name, const char *form) {
    const lg_system_row *row = find_row(name, form);
    return row ? row->state : NULL;
}

void lg_system_options_init(lg_system_options *options) {
    *options = (lg_system_options){.size = sizeof(lg_system_options), .links = 1};
}

/* ---- error messages ---- */

enum { LIST = 320 };

static void list_add(char list[LIST], const char *word) {
    if (word) lg_append(list, LIST, "%s%s", list[0] != '\0' ? ", " : "", word);
}

static lg_status fail_row(const char *name, const char *form, lg_error *error) {
    const lg_system_row *row = find_row(name, NULL);
    char known[LIST] = "";
    const char *before = "";
    for (size_t i = 0; row_at(i) != NULL; before = row_at(i++)->name)
        if (row && strcmp(row_at(i)->name, name) == 0)
            list_add(known, row_at(i)->form);
        else if (!row && strcmp(row_at(i)->name, before) != 0)
            list_add(known, row_at(i)->name);
    if (!row)
        return lg_fail(error, LG_NOT_FOUND, "there is no system \"%s\"; the systems are %s", name, known);
    if (known[0] == '\0')
        return lg_fail(error, LG_NOT_FOUND, "%s has no form \"%s\"; it has one form only", name, form);
    return lg_fail(error, LG_NOT_FOUND, "%s has no form \"%s\"; its forms are %s", name, form, known);
}

static lg_status fail_key(const char *system, const lg_parameter_entry *table, const char *key,
                          lg_error *error) {
    char known[LIST] = "";
    if (!key) key = "(null)";
    for (const lg_parameter_entry *p = table; p->key; p++) list_add(known, p->key);
    if (known[0] == '\0')
        return lg_fail(error, LG_INVALID_ARGUMENT, "%s has no parameter \"%s\"; it has no parameters", system,
                       key);
    return lg_fail(error, LG_INVALID_ARGUMENT, "%s has no parameter \"%s\"; its parameters are %s", system,
                   key, known);
}

/* ---- parameters ---- */

size_t lg_parameter_numbers(const lg_parameter_entry *parameter, size_t links) {
    return parameter->count > 0 ? parameter->count : links;
}

lg_status lg_parameter_find(const char *system, const lg_parameter_entry *table, const char *key,
                            const lg_parameter_entry **out, lg_error *error) {
    const lg_parameter_entry *p = table;
    while (p->key && !same(p->key, key)) p++;
    if (!p->key) return fail_key(system, table, key, error);
    *out = p;
    return LG_OK;
}

lg_status lg_parameter_check(const lg_parameter_entry *p, const double *x, size_t n, lg_error *error) {
    double square = 0.0;
    for (size_t i = 0; i < n; i++) {
        char place[32] = "";
        if (n > 1) (void)snprintf(place, sizeof(place), "[%zu]", i);
        if (!isfinite(x[i]))
            return lg_fail(error, LG_INVALID_ARGUMENT, "%s%s = %g is not finite", p->key, place, x[i]);
        if (p->rule == LG_PARAMETER_POSITIVE && !(x[i] > 0.0))
            return lg_fail(error, LG_INVALID_ARGUMENT, "%s%s = %g is not a positive number", p->key, place,
                           x[i]);
        if (p->rule == LG_PARAMETER_ANGLE && !(fabs(x[i]) <= 3.14159265358979323846))
            return lg_fail(error, LG_INVALID_ARGUMENT, "%s%s = %g is not an angle in radians from -pi to pi",
                           p->key, place, x[i]);
        square += x[i] * x[i];
    }
    if (p->rule == LG_PARAMETER_UNIT_VECTOR && !(fabs(sqrt(square) - 1.0) <= 1e-9))
        return lg_fail(error, LG_INVALID_ARGUMENT, "%s has length %.12g, not 1", p->key, sqrt(square));
    return LG_OK;
}

/* The entry of `options` with this key, or NULL. */
static const lg_named_values *given_for(const lg_system_options *options, const char *key) {
    for (size_t i = 0; i < options->parameter_count; i++)
        if (same(options->parameters[i].key, key)) return &options->parameters[i];
    return NULL;
}

static lg_status check_keys(const lg_system_row *row, const lg_system_options *options, lg_error *error) {
    if (options->parameter_count > 0 && !options->parameters)
        return lg_fail(error, LG_INVALID_ARGUMENT, "the parameters of %s are NULL", row->name);
    for (size_t i = 0; i < options->parameter_count; i++) {
        const lg_named_values *given = &options->parameters[i];
        const lg_parameter_entry *p = NULL;
        LG_TRY(lg_parameter_find(row->name, row->parameters, given->key, &p, error));
        if (given_for(options, given->key) != given)
            return lg_fail(error, LG_INVALID_ARGUMENT, "%s is given twice", p->key);
    }
    return LG_OK;
}

static lg_status check_parameter(const lg_system_row *row, const lg_system_options *options,
                                 const lg_parameter_entry *p, size_t links, lg_error *error) {
    const lg_named_values *given = given_for(options, p->key);
    const size_t n = lg_parameter_numbers(p, links);
    if (!given && !p->fallback)
        return lg_fail(error, LG_INVALID_ARGUMENT, "%s: the parameter \"%s\" (%s) must be given", row->name,
                       p->key, p->meaning);
    if (!given) return LG_OK;
    if (!given->values || given->count != n)
        return lg_fail(error, LG_INVALID_ARGUMENT, "%s: %zu number%s given, expected %zu%s", p->key,
                       given->values ? given->count : 0, given->values && given->count == 1 ? "" : "s", n,
                       p->count == 0 ? ", one per link" : "");
    return lg_parameter_check(p, given->values, n, error);
}

static void copy_parameter(const lg_system_options *options, const lg_parameter_entry *p, size_t links,
                           double *out) {
    const lg_named_values *given = given_for(options, p->key);
    for (size_t i = 0; i < lg_parameter_numbers(p, links); i++)
        out[i] = given ? given->values[i] : p->fallback[p->count > 0 ? i : 0];
}

/* Offset of the values of parameter `index`; the number of all values if there is no such parameter. */
static size_t parameter_offset(const lg_system_row *row, size_t links, size_t index) {
    size_t at = 0;
    for (size_t i = 0; i < index && row->parameters[i].key; i++)
        at += lg_parameter_numbers(&row->parameters[i], links);
    return at;
}

void lg_parameter_label(const lg_parameter_entry *table, size_t links, size_t index, char *text) {
    const lg_parameter_entry *p = table;
    while (p->key && index >= lg_parameter_numbers(p, links)) index -= lg_parameter_numbers(p++, links);
    if (!p->key)
        text[0] = '\0';
    else if (p->count == 1)
        (void)snprintf(text, LG_PARAMETER_LABEL, "%s", p->label);
    else
        (void)snprintf(text, LG_PARAMETER_LABEL, "%s%zu", p->label, index + 1);
}

void lg_system_parameter_label(const lg_system *system, size_t index, char *text) {
    lg_parameter_label(system->row->parameters, system->links, index, text);
}

/* ---- layout ---- */

/* A text under construction. If `at` is NULL, only its length is counted. */
typedef struct layout_text {
    char *at;
    size_t length;
} layout_text;

/* Appends the word, and the number unless it is 0. */
static void append(layout_text *text, const char *word, size_t number) {
    char part[64] = "";
    lg_append(part, sizeof part, number > 0 ? "%s%zu" : "%s", word, number);
    if (text->at) memcpy(text->at + text->length, part, strlen(part) + 1);
    text->length += strlen(part);
}

/* Writes the labels of the state's blocks in the order of their offsets, up to the first gap. `out` may be
 * NULL. Returns the length of the text. */
static size_t write_layout(const lg_system_row *row, size_t links, char *out) {
    layout_text text = {out, 0};
    size_t at = 0;
    for (const lg_state_entry *s = row->state; s->key;) {
        const size_t outer = s->outer > 0 ? s->outer : links;
        const size_t block = at >= s->first && s->stride > 0 ? (at - s->first) / s->stride : 0;
        if (block >= outer || at != s->first + block * s->stride) {
            s++;
            continue;
        }
        if (text.length > 0) append(&text, " ", 0);
        append(&text, s->key, s->outer != 1 ? block + 1 : 0);
        at += s->rows * s->columns;
        s = row->state;
    }
    return text.length;
}

/* ---- construction ---- */

#define LINKS_MAX 1000000

static bool has_links(const lg_system_row *row) {
    for (const lg_state_entry *s = row->state; s->key; s++)
        if (s->outer == 0) return true;
    return false;
}

static lg_status check_options(const lg_system_row *row, const lg_system_options *options, size_t links,
                               lg_error *error) {
    if (has_links(row) && (links < 1 || links > LINKS_MAX))
        return lg_fail(error, LG_INVALID_ARGUMENT, "links = %zu is not in 1 to %d", links, LINKS_MAX);
    LG_TRY(check_keys(row, options, error));
    for (const lg_parameter_entry *p = row->parameters; p->key; p++)
        LG_TRY(check_parameter(row, options, p, links, error));
    return LG_OK;
}

/* A system is one block of memory: the structure, parameters, constants, and the text of the layout. */
#define HEAD_DOUBLES ((sizeof(lg_system) + 7) / sizeof(double))

static size_t block_size(const lg_system_row *row, size_t links, size_t parameters, size_t constants) {
    const size_t text = write_layout(row, links, NULL) / sizeof(double) + 1;
    return (HEAD_DOUBLES + parameters + constants + text) * sizeof(double);
}

static void lay_out(lg_system *system, size_t constants) {
    system->parameters = (double *)system + HEAD_DOUBLES;
    system->constants = system->parameters + system->parameter_count;
    system->layout = (char *)(system->constants + constants);
}

/* A count of the row, which is per link if there are links. */
static size_t in_all(size_t count, size_t links) {
    return count * (links > 0 ? links : 1);
}

static lg_status make_space(const lg_system_row *row, size_t links, lg_space *out) {
    lg_space_factor factor[LG_SPACE_MAX_FACTORS];
    size_t n = 0;
    for (; row->factor[n].kind != LG_SPACE_RN || row->factor[n].count > 0; n++) {
        factor[n] = row->factor[n];
        if (factor[n].count == 0) factor[n].count = links;
    }
    LG_TRY(lg_space_init(out, factor, n));
    out->vectors = row->vectors;
    return LG_OK;
}

/* `system` is destroyed after an error. */
static lg_status finish(lg_system *system, lg_system **out) {
    const lg_status status = lg_recorded_create(system);
    if (status != LG_OK) lg_system_destroy(system);
    if (status == LG_OK) *out = system;
    return status;
}

static lg_status make(const lg_context *context, const lg_system_row *row, const lg_system_options *options,
                      size_t links, lg_system **out) {
    const size_t none = SIZE_MAX, count = parameter_offset(row, links, none);
    const size_t constants = in_all(row->constants, links);
    lg_space space;
    LG_TRY(make_space(row, links, &space));
    lg_system *system = lg_alloc(context, block_size(row, links, count, constants), 1);
    if (!system) return LG_OUT_OF_MEMORY;
    system->context = context;
    system->row = row;
    system->links = links;
    system->space = space;
    system->parameter_count = count;
    lay_out(system, constants);
    (void)write_layout(row, links, system->layout);
    for (size_t i = 0; row->parameters[i].key; i++)
        copy_parameter(options, &row->parameters[i], links,
                       system->parameters + parameter_offset(row, links, i));
    if (row->prepare) row->prepare(system, system->constants);
    return finish(system, out);
}

lg_status lg_system_create(const lg_context *context, const char *name, const lg_system_options *options,
                           lg_system **out, lg_error *error) {
    LG_NEEDS(error, name, out);
    lg_system_options defaults;
    lg_system_options_init(&defaults);
    if (!options) options = &defaults;
    if (options->size != sizeof(lg_system_options))
        return lg_fail(error, LG_INVALID_ARGUMENT, "the size of the system's options is %zu, expected %zu",
                       options->size, sizeof(lg_system_options));
    const lg_system_row *row = find_row(name, options->form);
    if (!row) return fail_row(name, options->form, error);
    const size_t links = has_links(row) ? options->links : 0;
    LG_TRY(check_options(row, options, links, error));
    const lg_status status = make(context, row, options, links, out);
    if (status == LG_OUT_OF_MEMORY) return lg_fail(error, status, "no memory for %s", row->name);
    return lg_fail(error, status, "%s", status == LG_OK ? "" : lg_status_sentence(status));
}

size_t lg_system_constants(const lg_system *system) {
    return in_all(system->row->constants, system->links);
}

lg_status lg_system_copy(const lg_context *context, const lg_system *system, lg_system **out) {
    LG_NEEDS(NULL, system, out);
    const size_t constants = lg_system_constants(system);
    const size_t bytes = block_size(system->row, system->links, system->parameter_count, constants);
    lg_system *copy = lg_alloc(context, bytes, 1);
    if (!copy) return LG_OUT_OF_MEMORY;
    memcpy(copy, system, bytes);
    copy->context = context;
    lay_out(copy, constants);
    return finish(copy, out);
}

lg_status lg_system_check_parameters(const lg_system *system, const double *values, lg_error *error) {
    for (const lg_parameter_entry *p = system->row->parameters; p->key; p++) {
        const size_t n = lg_parameter_numbers(p, system->links);
        LG_TRY(lg_parameter_check(p, values, n, error));
        values += n;
    }
    return LG_OK;
}

lg_status lg_system_set_parameters(lg_system *system, const double *values) {
    LG_NEEDS(NULL, system, values);
    LG_TRY(lg_system_check_parameters(system, values, NULL));
    memcpy(system->parameters, values, system->parameter_count * sizeof(*values));
    if (system->row->prepare) system->row->prepare(system, system->constants);
    return LG_OK;
}

void lg_system_destroy(lg_system *system) {
    for (size_t i = 0; system && i < LG_COUNT(system->plan); i++) lg_plan_destroy(system->plan[i]);
    if (system) lg_free(system->context, system);
}

/* ---- queries ---- */

const char *lg_system_name(const lg_system *system) {
    return system->row->name;
}

const char *lg_system_form(const lg_system *system) {
    return system->row->form;
}

const char *lg_system_layout(const lg_system *system) {
    return system->layout;
}

const lg_space *lg_system_space(const lg_system *system) {
    return &system->space;
}

size_t lg_system_parameter_count(const lg_system *system) {
    return system->parameter_count;
}

const double *lg_system_parameter_values(const lg_system *system) {
    return system->parameters;
}

size_t lg_system_dim(const lg_system *system) {
    return system->space.dim;
}

size_t lg_system_reported(const lg_system *system) {
    return system->space.dim - system->row->unreported;
}

size_t lg_system_links(const lg_system *system) {
    return system->links;
}

bool lg_system_constrained(const lg_system *system) {
    return !lg_space_is_abelian(&system->space);
}

bool lg_system_separable(const lg_system *system) {
    return system->row->force != NULL;
}

/* Doubles of workspace that the row needs. If the ambient field is generated from the LIE field, the
 * workspace has algebra_dim more doubles behind them, for the value of the LIE field. */
size_t lg_system_own_work(const lg_system *system) {
    return in_all(system->row->work, system->links) + system->recorded_work;
}

size_t lg_system_work_size(const lg_system *system) {
    const bool generated = lg_system_constrained(system) && !system->row->field[LG_COORDINATES_AMBIENT];
    const size_t work = lg_system_own_work(system) + (generated ? system->space.algebra_dim : 0);
    return (work > 0 ? work : 1) * sizeof(double);
}

/* ---- observation ---- */

size_t lg_system_observed(const lg_system *system) {
    const lg_system_row *row = system->row;
    return row->observed > 0 ? in_all(row->observed, system->links) : lg_system_reported(system);
}

lg_status lg_system_observe(const lg_system *system, const double *y, double *out, double *work) {
    if (!system || !y || !out || !work) return LG_INVALID_ARGUMENT;
    if (system->row->observe != NULL) return system->row->observe(system, y, out, work);
    memcpy(out, y, lg_system_reported(system) * sizeof(*out));
    return LG_OK;
}

/* ---- invariants ---- */

size_t lg_system_invariants(const lg_system *system) {
    size_t n = 0;
    while (system->row->invariants && system->row->invariants[n]) n++;
    return n;
}

const char *lg_system_invariant_name(const lg_system *system, size_t index) {
    return index < lg_system_invariants(system) ? system->row->invariants[index] : NULL;
}

double lg_system_invariant(const lg_system *system, size_t index, const double *y, double *work) {
    return index < lg_system_invariants(system) ? system->row->invariant(system, index, y, work) : NAN;
}

double lg_system_hamiltonian(const lg_system *system, const double *y, double *work) {
    return same(lg_system_invariant_name(system, 0), "energy") ? system->row->invariant(system, 0, y, work)
                                                               : NAN;
}

/* ---- fields ---- */

lg_coordinates lg_system_coordinates_for(const lg_scheme *scheme) {
    return scheme->ambient || scheme->kind == LG_SCHEME_SPLITTING ? LG_COORDINATES_AMBIENT
                                                                  : LG_COORDINATES_LIE;
}

static lg_status generated_field(void *user, double t, const double *y, const double *input, double *out) {
    const lg_system_user *own = user;
    double *algebra = own->work + lg_system_own_work(own->system);
    LG_TRY(own->system->row->field[LG_COORDINATES_LIE](user, t, y, input, algebra));
    lg_space_generator(&own->system->space, algebra, y, out);
    return LG_OK;
}

static lg_status separable_field(void *user, double t, const double *y, const double *input, double *out) {
    const lg_system *system = ((const lg_system_user *)user)->system;
    const size_t n = system->space.dim / 2;
    LG_TRY(system->row->velocity(user, t, y + n, input, out));
    return system->row->force(user, t, y, input, out + n);
}

static lg_vector_field field_of(const lg_system *system, lg_coordinates coordinates) {
    const lg_system_row *row = system->row;
    if (lg_system_separable(system)) return separable_field;
    if (coordinates == LG_COORDINATES_LIE || row->field[coordinates]) return row->field[coordinates];
    return lg_system_constrained(system) ? generated_field : row->field[LG_COORDINATES_LIE];
}

lg_status lg_system_ode(const lg_system *system, lg_coordinates coordinates, lg_ode *ode,
                        lg_system_user *user, double *work) {
    if (!system || !user || !work || !ode || (unsigned)coordinates > LG_COORDINATES_AMBIENT)
        return LG_INVALID_ARGUMENT;
    lg_ode result = {.space = system->space,
                     .field = field_of(system, coordinates),
                     .force = system->row->force,
                     .velocity = system->row->velocity,
                     .user = user,
                     .step = system->row->step};
    if (coordinates == LG_COORDINATES_AMBIENT) {
        result.manifold = system->space;
        LG_TRY(lg_space_init_rn(&result.space, system->space.dim));
    }
    *user = (lg_system_user){system, work};
    *ode = result;
    return LG_OK;
}

/* ---- fields on a tape ---- */

#define TAPED_HALF(name)                                                                                     \
    static lg_status name(void *user, lg_tape *tape, lg_taped_time t, lg_var x, lg_var input, lg_var *out) { \
        const lg_system_taped_user *own = user;                                                              \
        *out = own->system->row->name(tape, x, own->parameters);                                             \
        return lg_tape_status(tape);                                                                         \
    }
TAPED_HALF(taped_force)
TAPED_HALF(taped_velocity)

static lg_status taped_field(void *user, lg_tape *tape, lg_taped_time t, const lg_var *y, lg_var input,
                             lg_var *algebra) {
    const lg_system_taped_user *own = user;
    const uint32_t n = (uint32_t)own->system->space.dim / 2;
    lg_var half[2] = {LG_NONE, LG_NONE};
    if (!lg_system_separable(own->system))
        return own->system->row->taped(own->system, tape, t, y, input, own->parameters, algebra);
    const lg_var p = lg_slice(tape, y[0], -1, n, n);
    LG_TRY(taped_velocity(user, tape, t, p, input, &half[0]));
    const lg_var q = lg_slice(tape, y[0], -1, 0, n);
    LG_TRY(taped_force(user, tape, t, q, input, &half[1]));
    algebra[0] = lg_concat(tape, half, 2, -1);
    return lg_tape_status(tape);
}

static lg_status taped_ambient(void *user, lg_tape *tape, lg_taped_time t, const lg_var *y, lg_var input,
                               lg_var *out) {
    const lg_system_taped_user *own = user;
    const lg_space *space = &own->system->space;
    lg_var parts[LG_TAPED_MAX_PARTS], algebra[LG_TAPED_MAX_PARTS], velocity[LG_TAPED_MAX_PARTS];
    LG_TRY(lg_taped_split(tape, space, y[0], parts));
    LG_TRY(taped_field(user, tape, t, parts, input, algebra));
    LG_TRY(lg_taped_generator(tape, space, algebra, parts, velocity));
    *out = lg_taped_join(tape, space, velocity);
    return lg_tape_status(tape);
}

lg_status lg_system_taped_ode(const lg_system *system, lg_coordinates coordinates, lg_var parameters,
                              lg_taped_ode *ode, lg_system_taped_user *user) {
    if (!system || !user || !ode || (unsigned)coordinates > LG_COORDINATES_AMBIENT)
        return LG_INVALID_ARGUMENT;
    const bool ambient = coordinates == LG_COORDINATES_AMBIENT, constrained = lg_system_constrained(system);
    if (ambient && system->row->extended) return LG_UNSUPPORTED;
    lg_taped_ode result = {.space = system->space,
                           .field = ambient && constrained ? taped_ambient : taped_field,
                           .force = system->row->taped_force ? taped_force : NULL,
                           .velocity = system->row->taped_velocity ? taped_velocity : NULL,
                           .user = user};
    if (ambient) {
        result.manifold = system->space;
        LG_TRY(lg_space_init_rn(&result.space, system->space.dim));
    }
    *user = (lg_system_taped_user){system, parameters};
    *ode = result;
    return LG_OK;
}
