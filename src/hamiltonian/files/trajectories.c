/* Trajectory data sets: /t (M), /trajectories (N, M, d), /hamiltonian (N), /inputs (N, M-1, m). */
#include <float.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "files/frame.h"
#include "hamiltonian/files/constrained.h"
#include "hamiltonian/files/family.h"
#include "hamiltonian/internal.h"

#define TIME_TOLERANCE     1e-6 /* relative to dt */
#define TEXT_TOLERANCE     0.1  /* the same, of texts of few digits; a missing point moves a time by more */
#define MANIFOLD_TOLERANCE 1e-6

/* How many numbers each of the n copies has in a state. */
static uint32_t numbers_per_copy(const lg_hamiltonian_family *family) {
    lg_space one = {0};
    (void)lg_hamiltonian_space(family, 1, &one);
    return (uint32_t)one.dim;
}

/* ---- making and freeing ---- */

void lg_trajectories_destroy(lg_trajectories *data) {
    if (data == NULL) return;
    LG_FREE_ALL(data->context, data->t, data->data, data->hamiltonian, data->inputs);
    lg_system_destroy(data->truth);
    lg_constraint_destroy(data->constraint);
    *data = (lg_trajectories){0};
}

/* Allocates a b c zeros. b and c must not be 0. */
static double *array3(const lg_context *context, size_t a, size_t b, size_t c) {
    if (a > SIZE_MAX / b || a * b > SIZE_MAX / c) return NULL;
    return lg_alloc(context, a * b * c, sizeof(double));
}

lg_status lg_trajectories_create(const lg_context *context, const char *system,
                                 const lg_hamiltonian_family *family, uint32_t n, size_t count, size_t points,
                                 double t_end, bool with_hamiltonian, uint32_t input_dim,
                                 lg_trajectories *out) {
    if (system == NULL || out == NULL || strlen(system) >= LG_SYSTEM_NAME) return LG_INVALID_ARGUMENT;
    if (family == NULL || n < 1 || n > lg_hamiltonian_most_copies(family) || count < 1 || points < 2)
        return LG_INVALID_ARGUMENT;
    if (!isfinite(t_end) || t_end <= 0) return LG_INVALID_ARGUMENT;
    size_t known_n;
    const lg_hamiltonian_family *known = lg_family_of(system, &known_n);
    if (known != NULL && (known != family || (known_n != 0 && known_n != n))) return LG_INVALID_ARGUMENT;
    LG_CLEAN(lg_trajectories_destroy)
    lg_trajectories made = {.family = family,
                            .n = n,
                            .count = count,
                            .points = points,
                            .state_dim = n * numbers_per_copy(family),
                            .input_dim = input_dim,
                            .dt = t_end / (double)(points - 1),
                            .context = context};
    memcpy(made.system, system, strlen(system) + 1);
    made.t = lg_alloc(context, points, sizeof(double));
    made.data = array3(context, count, points, made.state_dim);
    if (with_hamiltonian) made.hamiltonian = lg_alloc(context, count, sizeof(double));
    if (input_dim > 0) made.inputs = array3(context, count, points - 1, input_dim);
    if (made.t == NULL || made.data == NULL || (with_hamiltonian && made.hamiltonian == NULL) ||
        (input_dim > 0 && made.inputs == NULL))
        return LG_OUT_OF_MEMORY;
    for (size_t j = 0; j < points; j++) made.t[j] = t_end * ((double)j / (double)(points - 1));
    return LG_GIVE(out, made);
}

lg_status lg_trajectories_set_constraint(lg_trajectories *data, const lg_program *program, lg_error *error) {
    if (data == NULL || data->family == NULL || !data->family->constrained)
        return lg_fail(error, LG_INVALID_ARGUMENT,
                       "only trajectories of family constrained have a constraint");
    lg_constraint *made;
    LG_TRY(lg_constraint_create(data->context, program, &made, error));
    if (lg_constraint_coordinates(made) != data->n) {
        lg_constraint_destroy(made);
        return lg_fail(error, LG_INVALID_ARGUMENT, "function constraint takes another number of coordinates");
    }
    lg_constraint_destroy(data->constraint);
    data->constraint = made;
    return LG_OK;
}

/* ---- the system that made the data ---- */

/* Makes data->truth from a form and parameters of the data's system. LG_INVALID_ARGUMENT if a parameter is
 * missing, or the system does not fit the data. */
static lg_status make_truth(lg_trajectories *data, const char *form, const lg_named_values *given,
                            size_t count, lg_error *error) {
    lg_system *made = NULL;
    lg_system_options options;
    size_t n;
    lg_system_options_init(&options);
    options.form = form;
    options.links = data->n;
    options.parameters = given;
    options.parameter_count = count;
    LG_TRY(lg_system_create(data->context, data->system, &options, &made, error));
    if (lg_hamiltonian_family_for(made, &n) != data->family || n != data->n) {
        lg_system_destroy(made);
        return lg_fail(error, LG_INVALID_ARGUMENT, "the system is not the system of the data");
    }
    lg_system_destroy(data->truth);
    data->truth = made;
    return LG_OK;
}

lg_status lg_trajectories_set_truth(lg_trajectories *data, const lg_system *system) {
    lg_named_values given[LG_MOST_PARAMETERS];
    size_t count = 0;
    if (data == NULL || system == NULL || strcmp(lg_system_name(system), data->system) != 0)
        return LG_INVALID_ARGUMENT;
    const double *values = lg_system_parameter_values(system);
    const lg_parameter_entry *row = lg_system_parameters(data->system, lg_system_form(system));
    for (; row->key != NULL; row++) {
        const size_t size = row->count > 0 ? row->count : lg_system_links(system);
        given[count++] = (lg_named_values){row->key, values, size};
        values += size;
    }
    return make_truth(data, lg_system_form(system), given, count, NULL);
}

/* ---- the hash ---- */

static void hash(lg_trajectories *data) {
    lg_sha256 state;
    lg_sha256_init(&state);
    lg_sha256_add_doubles(&state, data->t, data->points);
    lg_sha256_add_doubles(&state, data->data, data->count * data->points * data->state_dim);
    if (data->inputs != NULL)
        lg_sha256_add_doubles(&state, data->inputs, data->count * (data->points - 1) * data->input_dim);
    if (data->constraint != NULL) (void)lg_constraint_hash(data->constraint, &state);
    lg_sha256_finish(&state, data->sha256);
}

/* ---- the arrays of a file ---- */

enum { TIMES, TRAJECTORIES, OTHERS, ARRAYS = 4 };

typedef struct sizes {
    lg_h5_size trajectories, points, dim, intervals, inputs;
} sizes;

static void list_arrays(lg_trajectories *data, sizes *s, lg_h5_array out[ARRAYS]) {
    *s = (sizes){{data->count, "trajectories", NULL},
                 {data->points, "points", NULL},
                 {data->state_dim, "numbers per state", NULL},
                 {data->points > 0 ? data->points - 1 : 0, "intervals", NULL},
                 {data->input_dim, "inputs", NULL}};
    const lg_h5_array list[ARRAYS] = {
        {"t", &data->t, {&s->points}, false},
        {"trajectories", &data->data, {&s->trajectories, &s->points, &s->dim}, false},
        {"hamiltonian", &data->hamiltonian, {&s->trajectories}, true},
        {"inputs", &data->inputs, {&s->trajectories, &s->intervals, &s->inputs}, true}};
    memcpy(out, list, sizeof list);
}

/* ---- reading ---- */

typedef struct read_call {
    const lg_context *context;
    const char *path;
    lg_h5 *h5;
    lg_trajectories *out;
    double epsilon; /* relative rounding error of the type that stores /t */
    lg_clock clock; /* of times that are texts */
    size_t digits;  /* of the text with the most digits */
    double unit;    /* of the last one of these digits, in seconds; the largest if several texts have them */
    bool project;
    const lg_program *constraint; /* of the options */
} read_call;

/* Counts the digits of a time from the first one that is not 0. Programs leave out zeros at the end, so the
 * text with the most digits shows to which unit all texts of a column are rounded. */
static void count_digits(read_call *call, const char *text, lg_time_format format) {
    const size_t end = strcspn(text, "eE"), point = strcspn(text, ".");
    const long power = text[end] != '\0' ? strtol(text + end + 1, NULL, 10) : 0;
    const size_t places = text[point] != '\0' ? strspn(text + point + 1, "0123456789") : 0;
    double unit = pow(10, (double)power - (double)places);
    size_t digits = 0;
    for (size_t i = strcspn(text, "123456789"); i < end; i++) digits += text[i] >= '0' && text[i] <= '9';
    if (format != LG_TIME_SECONDS) unit = fmax(unit, 1e-9); /* lg_moment leaves out further digits */
    if (digits < call->digits) return;
    call->unit = digits > call->digits ? unit : fmax(call->unit, unit);
    call->digits = digits;
}

/* Times that are texts become seconds since the first one, as in a log. */
static lg_status take_time(void *user, uint64_t index, const char *text, lg_error *error) {
    read_call *call = user;
    lg_moment now;
    const char *end = lg_moment_scan(text, &now);
    const double t = end != NULL && *end == '\0' ? lg_clock_read(&call->clock, now) : (double)NAN;
    call->out->t[index] = t;
    if (!isfinite(t))
        return lg_h5_fail(
            call->h5, error,
            "/t: the text at index (%llu) is no time%s: write numbers of seconds, or dates such "
            "as 2024-03-01T12:00:00.25Z",
            (unsigned long long)index, index > 0 ? " in the format of the first one" : "");
    count_digits(call, text, now.format);
    return LG_OK;
}

static lg_status read_arrays(read_call *call, lg_error *error) {
    lg_trajectories *out = call->out;
    sizes s;
    lg_h5_array arrays[ARRAYS];
    lg_h5_about times;
    list_arrays(out, &s, arrays);
    LG_TRY(lg_h5_get_arrays(call->h5, arrays + TRAJECTORIES, 1, error));
    if (s.points.n < 2 || s.dim.n < 2 || s.dim.n > 6 * LG_HAMILTONIAN_MAX_COPIES)
        return lg_h5_fail(
            call->h5, error, "/trajectories: has M = %llu and d = %llu, expected M >= 2 and d of 2 to %d",
            (unsigned long long)s.points.n, (unsigned long long)s.dim.n, 6 * LG_HAMILTONIAN_MAX_COPIES);
    s.intervals.n = s.points.n - 1;
    LG_TRY(lg_h5_fit(call->h5, &arrays[TIMES], sizeof(double), true, &times, error));
    call->epsilon = times.kind == LG_H5_WORDS ? DBL_EPSILON : times.epsilon;
    out->t = lg_alloc(call->context, (size_t)s.points.n, sizeof(double));
    if (out->t == NULL) return lg_h5_no_memory(call->h5, error);
    LG_TRY(times.kind == LG_H5_WORDS
               ? lg_h5_each_text(call->h5, "t", take_time, call, error)
               : lg_h5_get_finite(call->h5, "t", times.rank, times.dims, out->t, error));
    LG_TRY(lg_h5_get_arrays(call->h5, arrays + OTHERS, ARRAYS - OTHERS, error));
    if (s.inputs.n > UINT32_MAX) return lg_h5_fail(call->h5, error, "/inputs: has too many inputs");
    out->count = (size_t)s.trajectories.n, out->points = (size_t)s.points.n;
    out->state_dim = (uint32_t)s.dim.n, out->input_dim = (uint32_t)s.inputs.n;
    return LG_OK;
}

static lg_status check_times(read_call *call, lg_error *error) {
    lg_trajectories *out = call->out;
    size_t last = out->points - 1;
    const double *t = out->t;
    double dt = (t[last] - t[0]) / (double)last, largest = fmax(fabs(t[0]), fabs(t[last]));
    /* Of a rounded time and of the straight line between two: half a unit each. */
    double rounded = fmin(call->unit, TEXT_TOLERANCE * dt) + 2 * call->epsilon * largest;
    double tolerance = TIME_TOLERANCE * dt + rounded;
    if (!isfinite(dt))
        return lg_h5_fail(call->h5, error,
                          "/t: the time from the first to the last point is not a finite number");
    for (size_t i = 1; i <= last; i++) {
        if (!(t[i] > t[i - 1]))
            return lg_h5_fail(call->h5, error,
                              "/t: does not increase at index (%zu): sort the points by time", i);
    }
    for (size_t i = 1; i < last; i++) {
        double off = fabs(t[i] - (t[0] + (double)i * dt));
        if (off > tolerance)
            return lg_h5_fail(
                call->h5, error,
                "/t: the times are not equidistant: the time at index (%zu) is off by %.3g steps; "
                "interpolate the points at equidistant times",
                i, off / dt);
    }
    out->dt = dt;
    return LG_OK;
}

/* The object that has an attribute, the root or /trajectories; NULL if none has it. */
static const char *holder_of(const read_call *call, const char *name) {
    return lg_h5_has_attribute(call->h5, "", name)               ? ""
           : lg_h5_has_attribute(call->h5, "trajectories", name) ? "trajectories"
                                                                 : NULL;
}

/* Reads a text attribute. If the file does not have it, the text is "". */
static lg_status optional_text(read_call *call, const char *name, char *text, size_t size, lg_error *error) {
    const char *holder = holder_of(call, name);
    text[0] = '\0';
    if (holder == NULL) return LG_OK;
    return lg_as_format(lg_h5_text(call->h5, holder, name, text, size, error), error);
}

/* Whether a text without separators is a layout of the family: numbered, q1 p1 q2 p2 ..., or else q p or
 * q1 q2 ... p1 p2 .... No text is both a numbered layout and another one, whatever the families. */
static bool is_layout(const lg_hamiltonian_family *family, const char *text, bool numbered) {
    char all[32] = "", counted[32];
    (void)snprintf(counted, sizeof counted, "%s1%s2", family->layout[0], family->layout[0]);
    for (const char *const *part = family->layout; *part != NULL; part++)
        lg_append(all, sizeof all, "%s%s", *part, numbered ? "1" : "");
    if (numbered) return strncmp(text, all, strlen(all)) == 0;
    return strcmp(text, all) == 0 || strncmp(text, counted, strlen(counted)) == 0;
}

static bool is_any_layout(const char *text, bool numbered) {
    bool found = false;
    for (size_t i = 0; i < lg_hamiltonian_family_count(); i++)
        found = found || is_layout(lg_hamiltonian_family_at(i), text, numbered);
    return found;
}

static lg_status check_starts(read_call *call, lg_error *error) {
    lg_trajectories *out = call->out;
    lg_space space;
    LG_TRY(lg_hamiltonian_space(out->family, out->n, &space));
    for (size_t k = 0; k < out->count; k++) {
        uint32_t copy = 0;
        double *start = out->data + k * out->points * out->state_dim;
        const double off = lg_hamiltonian_off_manifold(out->family, out->n, start, &copy);
        out->starts_off = off > out->starts_off ? off : out->starts_off;
        if (off > MANIFOLD_TOLERANCE && call->project)
            lg_space_project(&space, start);
        else if (off > MANIFOLD_TOLERANCE)
            return lg_h5_fail(
                call->h5, error,
                "/trajectories: the first point of trajectory %zu is off the manifold by %.3g (%s %u "
                "must satisfy %s; if the difference is noise, give --initial-states measured or estimated)",
                k, off, out->family->copy, copy + 1, out->family->manifold);
    }
    return LG_OK;
}

static bool has_size(const lg_hamiltonian_family *family, uint32_t d) {
    const uint32_t per = numbers_per_copy(family);
    return d % per == 0 && d / per <= lg_hamiltonian_most_copies(family);
}

/* Whether d fits the family, and every first point lies on the family's manifold. */
static bool looks_like(const lg_hamiltonian_family *family, const lg_trajectories *out) {
    const uint32_t per = numbers_per_copy(family);
    uint32_t copy = 0;
    if (!has_size(family, out->state_dim)) return false;
    for (size_t k = 0; k < out->count; k++) {
        const double *start = out->data + k * out->points * out->state_dim;
        if (lg_hamiltonian_off_manifold(family, out->state_dim / per, start, &copy) > MANIFOLD_TOLERANCE)
            return false;
    }
    return true;
}

/* Guesses the family of data without a known system. If the data have a layout (without separators), it is
 * the first family that has this layout and allows states of d numbers; if no family allows d, it is the
 * first family that has this layout. If the data have no layout, it is the first family on whose manifold all
 * trajectories begin. If no family fits, it is the last family. For one degree of freedom both layouts are
 * the same. */
static const lg_hamiltonian_family *guess_family(const lg_trajectories *out, const char *layout) {
    const lg_hamiltonian_family *family = NULL, *other_size = NULL;
    for (size_t i = 0; i < lg_hamiltonian_family_count(); i++) {
        family = lg_hamiltonian_family_at(i);
        if (family->constrained) continue;
        const bool laid_out = layout[0] != '\0' && is_layout(family, layout, family->numbered) &&
                              (!family->numbered || out->state_dim >= numbers_per_copy(family));
        if (layout[0] == '\0' ? looks_like(family, out) : laid_out && has_size(family, out->state_dim))
            return family;
        if (laid_out && other_size == NULL) other_size = family;
    }
    return other_size != NULL ? other_size : family;
}

static lg_status check_size(const lg_trajectories *out, const char *shown, size_t known_n, lg_error *error) {
    const uint32_t per = numbers_per_copy(out->family);
    const uint32_t most = lg_hamiltonian_most_copies(out->family);
    if (!has_size(out->family, out->state_dim))
        return lg_fail(error, LG_FORMAT,
                       "%s: /trajectories: d = %u, expected %u numbers for each of 1 to %u %ss", shown,
                       out->state_dim, per, most, out->family->copy);
    if (known_n != 0 && known_n != out->state_dim / per)
        return lg_fail(error, LG_FORMAT, "%s: /trajectories: d = %u, but a state of %s has %zu numbers",
                       shown, out->state_dim, out->system, known_n * per);
    return LG_OK;
}

static lg_status check_system(read_call *call, lg_error *error) {
    lg_trajectories *out = call->out;
    const char *shown = lg_shown_path(call->path);
    char layout[1024];
    size_t known_n = 0;
    LG_TRY(optional_text(call, "system", out->system, sizeof out->system, error));
    if (out->constraint != NULL) return lg_constrained_size(call->path, out, error);
    LG_TRY(optional_text(call, "layout", layout, sizeof layout, error));
    const lg_hamiltonian_family *known = lg_family_of(out->system, &known_n);
    char *to = layout; /* without separators "q_1, p_1" and "q1 p1" are the same */
    for (const char *from = layout; *from != '\0'; from++)
        if (strchr(" ,;_\t[]()", *from) == NULL) *to++ = *from;
    *to = '\0';
    const bool laid_out = layout[0] != '\0', numbered = is_any_layout(layout, true);
    if (laid_out && !numbered && !is_any_layout(layout, false))
        return lg_fail(error, LG_FORMAT,
                       "%s: attribute layout: is '%.100s', expected 'q1 p1 q2 p2 ...' or 'q p'", shown,
                       layout);
    const bool named = out->system[0] != '\0', listed = lg_system_parameters(out->system, NULL) != NULL;
    if (known == NULL && named && !laid_out)
        return lg_fail(error, LG_FORMAT,
                       listed ? "%s: attribute system: '%s' fits no family of learned Hamiltonians; "
                                "lg-identify learns other machines"
                              : "%s: attribute system: '%s' is not a known system; for other systems "
                                "attribute layout is needed",
                       shown, out->system);
    out->guessed = !named && !laid_out;
    out->family = known != NULL ? known : guess_family(out, layout);
    LG_TRY(check_size(out, shown, known_n, error));
    out->n = out->state_dim / numbers_per_copy(out->family);
    if (laid_out && numbered != out->family->numbered && out->n > 1)
        return lg_fail(error, LG_FORMAT, "%s: attribute layout: expected '%s' for %s", shown,
                       out->family->numbered ? "q1 p1 q2 p2 ..." : "q p",
                       known != NULL ? out->system : "this system");
    return LG_OK;
}

/* Only for numbered layouts. For other layouts programs disagree what `links` means, and d determines n. */
static lg_status check_links(read_call *call, lg_error *error) {
    const lg_trajectories *out = call->out;
    const char *holder = holder_of(call, "links");
    int64_t links = out->n;
    if (holder == NULL || !out->family->numbered) return LG_OK;
    LG_TRY(lg_h5_number(call->h5, holder, "links", LG_ELEMENT_I64, &links, error));
    if (links == (int64_t)out->n) return LG_OK;
    return lg_h5_fail(call->h5, error, "attribute links is %lld, but states of d = %u numbers have %u",
                      (long long)links, out->state_dim, out->n);
}

static void parameter_path(const lg_parameter_entry *row, char path[64]) {
    (void)snprintf(path, 64, "parameters/%s", row->key);
}

typedef struct truth_values {
    const lg_context *context;
    double *of[LG_MOST_PARAMETERS];
} truth_values;

static void free_values(const truth_values *values) {
    for (size_t i = 0; i < LG_COUNT(values->of); i++) lg_free(values->context, values->of[i]);
}

/* Makes out->truth from the parameters in the file, in the form of the system that is learned. If the
 * system is unknown or the file lacks one of its parameters, out->truth stays empty. */
static lg_status read_truth(read_call *call, lg_error *error) {
    lg_trajectories *out = call->out;
    lg_named_values given[LG_MOST_PARAMETERS];
    LG_CLEAN(free_values) truth_values values = {.context = call->context};
    size_t count = 0;
    char path[64];
    const char *form = lg_learned_form(out->system);
    const lg_parameter_entry *row = lg_system_parameters(out->system, form);
    if (row == NULL) return LG_OK;
    for (size_t i = 0; row[i].key != NULL; i++) {
        parameter_path(row + i, path);
        if (!lg_h5_has(call->h5, path)) return LG_OK;
    }
    for (; row->key != NULL; row++, count++) {
        lg_h5_size size = {0, NULL, NULL};
        parameter_path(row, path);
        LG_TRY(lg_h5_get_arrays(call->h5, &(lg_h5_array){path, &values.of[count], {&size}, false}, 1, error));
        given[count] = (lg_named_values){row->key, values.of[count], (size_t)size.n};
    }
    lg_error why = {LG_OK, ""};
    const lg_status status = make_truth(out, form, given, count, &why);
    if (status == LG_OK) return LG_OK;
    return lg_fail(error, status == LG_INVALID_ARGUMENT ? LG_FORMAT : status, "%s: /parameters: %s",
                   lg_shown_path(call->path), why.message);
}

static lg_status read_checked(void *user, lg_h5 *h5, lg_error *error) {
    read_call *call = user;
    call->h5 = h5;
    LG_TRY(lg_h5_check_format(call->h5, "trajectories", true, error));
    LG_TRY(read_arrays(call, error));
    LG_TRY(check_times(call, error));
    LG_TRY(lg_h5_constraint(h5, call->constraint, &call->out->constraint, error));
    LG_TRY(check_system(call, error));
    LG_TRY(check_links(call, error));
    LG_TRY(check_starts(call, error));
    if (call->out->constraint != NULL)
        LG_TRY(lg_constrained_points(call->path, call->project, call->out, error));
    LG_TRY(read_truth(call, error));
    lg_h5_provenance(call->h5, &call->out->provenance);
    return LG_OK;
}

lg_status lg_trajectories_read(const lg_context *context, const char *path, const lg_read_options *options,
                               lg_trajectories *out, lg_error *error) {
    LG_NEEDS(error, path, out);
    LG_CLEAN(lg_trajectories_destroy) lg_trajectories made = {.context = context};
    const bool project = options != NULL && options->project_starts;
    read_call call = {.context = context, .path = path, .project = project, .out = &made};
    if (options != NULL) call.constraint = options->constraint;
    LG_TRY(lg_h5_read(context, path, options, read_checked, &call, error));
    hash(&made);
    return LG_GIVE(out, made);
}

/* ---- writing ---- */

static lg_status put_truth(lg_h5 *h5, const lg_system *truth, lg_error *error) {
    if (truth == NULL) return LG_OK;
    const double *values = lg_system_parameter_values(truth);
    const lg_parameter_entry *row = lg_system_parameters(lg_system_name(truth), lg_system_form(truth));
    for (; row->key != NULL; row++) {
        const uint64_t size = row->count > 0 ? row->count : lg_system_links(truth);
        char path[64];
        parameter_path(row, path);
        LG_TRY(lg_h5_put(h5, path, LG_ELEMENT_F64, 1, &size, values, error));
        values += size;
    }
    return LG_OK;
}

static lg_status put_all(lg_h5 *h5, lg_trajectories *data, lg_error *error) {
    char layout[LG_LAYOUT_TEXT];
    lg_h5_array arrays[ARRAYS];
    sizes s;
    list_arrays(data, &s, arrays);
    lg_layout_text(data->family, data->n, layout);
    LG_TRY(lg_h5_put_header(h5, "trajectories", &data->provenance, error));
    if (data->system[0] != '\0') LG_TRY(lg_h5_put_text(h5, "", "system", data->system, error));
    LG_TRY(lg_h5_put_text(h5, "", "layout", layout, error));
    LG_TRY(lg_h5_put_number(h5, "", "links", LG_ELEMENT_U32, &data->n, error));
    LG_TRY(lg_h5_put_text(h5, "", "data_sha256", data->sha256, error));
    LG_TRY(lg_h5_put_arrays(h5, arrays, ARRAYS, error));
    if (data->constraint != NULL) LG_TRY(lg_h5_put_constraint(h5, data->constraint, error));
    return put_truth(h5, data->truth, error);
}

lg_status lg_trajectories_write(const lg_context *context, const char *path, lg_trajectories *data,
                                lg_error *error) {
    if (path == NULL || data == NULL || data->t == NULL || data->data == NULL || data->count < 1 ||
        data->points < 2)
        return lg_fail(
            error, LG_INVALID_ARGUMENT,
            "to write trajectories, a path, times, and at least one trajectory of two points are needed");
    lg_h5 *h5;
    LG_TRY(lg_h5_create(context, path, &h5, error));
    hash(data);
    return lg_h5_finish(h5, put_all(h5, data, error), error);
}
