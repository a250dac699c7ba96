/* Writes the C of a model: all faces whose functions the model's program has. */
#include "lg-export/faces.h"

#include <math.h>
#include <string.h>

#include "liegrad/mechanics.h"

enum { ATTEMPTS = 20 };

/* ---- the tables ---- */

static bool has_value(const export_model *m) {
    return m->source->outputs > 0;
}

const export_face export_face_value = {.functions = {{"value", "eval", false}, {"grad", "grad", false}},
                                       .fits = has_value};

#define FACE(name) &export_face_##name,
static const export_face *const faces[] = {EXPORT_FACE_LIST(FACE)};
#define KIND(name) &export_kind_##name,
static const export_kind *const kinds[] = {EXPORT_KIND_LIST(KIND)};

const export_kind *export_kind_of(const lg_recipe *recipe) {
    size_t i = 0;
    while (kinds[i]->recipe != NULL && kinds[i]->recipe != recipe) i++;
    return kinds[i];
}

/* ---- choosing faces ---- */

static bool has_function(const lg_program *program, const char *name) {
    return lg_program_find(program, name, &(size_t){0}, NULL) == LG_OK;
}

bool export_has(const export_model *m, const export_face *face) {
    size_t i = 0;
    while (i < m->face_count && m->faces[i] != face) i++;
    return i < m->face_count;
}

/* Returns the index of a function in m->functions, or m->count if it is not written. */
static size_t place_of(const export_model *m, const char *function) {
    size_t i = 0;
    while (i < m->count && strcmp(m->functions[i].function, function) != 0) i++;
    return i;
}

size_t export_work_of(const export_model *m, const char *function) {
    const size_t at = place_of(m, function);
    return at < m->count ? m->functions[at].work : 0;
}

static size_t functions_of(const export_face *face) {
    size_t count = 0;
    while (count < EXPORT_MOST_FUNCTIONS && face->functions[count].function != NULL) count++;
    return count;
}

static bool is_there(const export_model *m, const export_face *face) {
    bool all = true;
    for (size_t i = 0; i < functions_of(face); i++)
        all = all && has_function(m->program, face->functions[i].function);
    return all && face->fits(m);
}

static bool is_hidden(const export_model *m, const export_face *face, size_t k) {
    return face->functions[k].hidden ||
           (m->kind->hidden != NULL && strcmp(m->kind->hidden, face->functions[k].function) == 0);
}

static void choose(export_model *m) {
    for (size_t i = 0; i < LG_COUNT(faces); i++) {
        const export_face *face = faces[i];
        if (!is_there(m, face)) continue;
        m->faces[m->face_count++] = face;
        for (size_t k = 0; k < functions_of(face); k++)
            if (place_of(m, face->functions[k].function) == m->count)
                m->functions[m->count++] = (export_function){.function = face->functions[k].function,
                                                             .name = face->functions[k].name,
                                                             .hidden = is_hidden(m, face, k)};
    }
}

/* ---- code ---- */

/* Returns the kind's depth, or the depth of the deepest function other than `step`. The depth of a step would
 * overestimate its rounding errors, because the small h reduces them. */
static size_t depth_of(const export_model *m) {
    size_t depth = 1;
    if (m->kind->depth != NULL) return m->kind->depth(m->file->contents);
    for (size_t i = 0; i < m->count; i++)
        if (strcmp(m->functions[i].function, "step") != 0 && m->functions[i].depth > depth)
            depth = m->functions[i].depth;
    return depth;
}

static void add_code(export_model *m) {
    export_source *source = m->source;
    export_bundle(m->self, source, m->program, m->functions, m->count);
    source->depth = depth_of(m);
    for (size_t i = 0; i < m->face_count; i++) {
        if (m->faces[i]->code != NULL) m->faces[i]->code(m);
        source->stack += m->faces[i]->stack;
        source->calls += m->faces[i]->calls;
    }
}

/* ---- golden vectors ---- */

void export_turn(export_model *m, double *x) {
    APP_FREE double *element = app_alloc(m->algebra, sizeof *element);
    export_rest(m->space, x);
    for (size_t k = 0; k < m->algebra; k++) element[k] = lg_rng_normal(&m->rng);
    lg_space_act(m->space, element, x, x);
}

/* Draws a random state; flat factors get random numbers. */
static void draw_state(export_model *m, double *x) {
    double *at = x;
    memset(x, 0, m->dim * sizeof *x);
    for (size_t f = 0; f < m->space->factors; f++) {
        const lg_space_entry *entry = lg_space_kind_entry(m->space->factor[f].kind);
        const size_t numbers = entry->state * m->space->factor[f].count;
        for (size_t i = 0; entry->lift == NULL && i < numbers; i++) at[i] = lg_rng_normal(&m->rng);
        at += numbers;
    }
    export_turn(m, x);
}

/* Draws a random start on the space, or numbers within the ranges of the ports of `value`. */
static void draw_start(export_model *m, double *x) {
    if (m->space != NULL) {
        if (lg_space_draw_start(m->space, NULL, &m->rng, x) != LG_OK) draw_state(m, x);
        return;
    }
    export_draw_port(export_ports_of(m->program, "value").in, &m->rng, x);
}

static bool draw(export_model *m, size_t v) {
    export_source *source = m->source;
    double *x = source->golden.x + v * source->inputs;
    if (m->kind->draw != NULL)
        m->kind->draw(m, x, v);
    else
        draw_start(m, x);
    for (size_t i = 0; i < source->inputs; i++) x[i] = export_round(source->options, x[i]);
    if (export_has(m, &export_face_value))
        lg_model_jacobian(m->file->model, x, source->golden.y + v * source->outputs,
                          source->golden.jacobian + v * source->outputs * source->inputs, m->work);
    return (m->scores == NULL || export_draw_classes(m, v)) &&
           (m->kind->is_smooth == NULL || m->kind->is_smooth(m, v));
}

static lg_status add_golden(export_model *m) {
    const bool classes = export_has(m, &export_face_classes);
    const size_t scores = (size_t)m->window.names.classes + 1;
    lg_status status = LG_OK;
    lg_rng_seed(&m->rng, m->source->options->seed, m->kind->stream);
    if (m->window.names.channels > 0)
        export_window_golden(m->source, classes ? scores : 0);
    else
        export_golden_make(m->source, export_has(m, &export_face_value));
    if (classes) {
        LG_TRY(export_evaluation_open(m->program, "probability", LG_F64, 0, &m->probability, NULL));
        m->scores = export_golden_further(m->source, scores, "probabilities, class");
    }
    for (size_t v = 0; v < m->source->golden.count; v++)
        for (int attempt = 0; attempt < ATTEMPTS && !draw(m, v); attempt++) continue;
    for (size_t i = 0; i < m->face_count && status == LG_OK; i++)
        if (m->faces[i]->golden != NULL) status = m->faces[i]->golden(m);
    return status;
}

/* ---- condition ---- */

/* Windows at which the condition is measured besides the golden ones, which may be few. */
enum { WINDOWS = 48 };

/* Sets source->condition to the largest factor by which one of these functions multiplies rounding errors at
 * the golden vectors: grad, field and step of models that move; value and grad of other models, rounded up to
 * a whole number. A gradient with kinks is left out: rounding may choose either side. */
static lg_status measure_condition(export_model *m, lg_error *error) {
    static const char *const names[] = {"value", "grad", "field", "step"};
    const export_golden *golden = &m->source->golden;
    const bool kinks = m->kind->kinks != NULL && m->kind->kinks(m->file->contents);
    const size_t n = m->source->inputs, count = golden->count + (m->window.names.channels > 0 ? WINDOWS : 0);
    APP_FREE double *x = app_alloc(count * (n + m->forces + 1), sizeof *x),
                    *drawn = app_alloc(count * n, sizeof *drawn);
    lg_status status = LG_OK;
    memcpy(drawn, golden->x, golden->count * n * sizeof *drawn);
    for (size_t i = golden->count; i < count; i++) m->kind->draw(m, drawn + i * n, i);
    for (size_t f = m->space != NULL; f < LG_COUNT(names) && status == LG_OK; f++) {
        size_t at = 0;
        double found = 1.0;
        if (place_of(m, names[f]) == m->count || (f == 1 && kinks)) continue;
        for (size_t i = 0; i < count; i++) {
            for (size_t k = 0; k < n; k++) x[at++] = (double)(float)drawn[i * n + k];
            for (size_t k = 0; k < m->forces && f > 1; k++) x[at++] = (double)(float)m->input[k];
            if (f == 3) x[at++] = (double)(float)m->h;
        }
        status = export_amplification(m->program, names[f], x, count, m->source->depth, &found, error);
        if (m->space == NULL) found = ceil(found);
        if (status == LG_OK && isfinite(found)) m->source->condition = fmax(m->source->condition, found);
    }
    return status;
}

/* ---- the export ---- */

static void write_model(export_model *m) {
    add_code(m);
    const lg_status status = add_golden(m);
    if (status != LG_OK)
        app_stop(m->self, status == LG_NOT_FINITE ? LG_FILE : status,
                 "%s: golden vectors of its field and step: %s", m->source->options->file,
                 lg_status_sentence(status));
    EXPORT_MUST(m, measure_condition(m, &error));
    m->kind->tell(m);
    if (m->kind->recipe != NULL) export_tell_facts(m);
    export_warn_delay(m->self, m->source);
}

/* Sets the sizes that the library knows about the model. */
static void measure(export_model *m) {
    const lg_model *model = m->file->model;
    const lg_program *program = lg_model_program(model);
    m->source->inputs = lg_model_inputs(model);
    m->source->outputs = lg_model_outputs(model);
    m->source->parameters = m->kind->recipe != NULL ? lg_model_parameters(model) : export_parameters(program);
    m->space = lg_model_space(model);
    if (m->space != NULL) {
        m->dim = m->space->dim;
        m->algebra = m->space->algebra_dim;
        m->forces = lg_model_input_dim(model);
        m->tangent = lg_model_tangent_dim(model);
    }
    const export_ports state = export_ports_of(program, "momenta"),
                       chances = export_ports_of(program, "probability");
    m->positions = state.ins > 1 ? lg_shape_count(state.in[0].shape) : 0;
    m->velocities = state.ins > 1 ? lg_shape_count(state.in[1].shape) : 0;
    if (m->kind->window != NULL) m->kind->window(m->file->contents, &m->window);
    m->window.names.classes = (uint32_t)export_numbers(chances.out, chances.outs > 0);
}

/* Checks the scheme and the model before the program is made. */
static void check(export_model *m) {
    const lg_scheme *scheme = m->source->options->scheme;
    const bool own = scheme != NULL && scheme->kind == LG_SCHEME_VARIATIONAL &&
                     (m->positions > 0 || !lg_space_is_abelian(m->space));
    if (m->space != NULL && scheme != NULL && !own)
        export_check_scheme(m->self, m->space, has_function(lg_model_program(m->file->model), "force"),
                            scheme);
    if (m->kind->begin != NULL) m->kind->begin(m);
}

void export_faces(const app *self, const lg_model_file *file, export_source *source, bool *none) {
    export_model m = {.self = self, .file = file, .kind = export_kind_of(file->recipe), .source = source};
    measure(&m);
    check(&m);
    if (m.kind->words != NULL) m.kind->words(file->contents, source);
    APP_MUST_FILE(self, self->arguments[0],
                  lg_model_file_program(file, source->options->scheme, &m.program, &error));
    choose(&m);
    *none = m.face_count == 0;
    m.input = app_keep(m.forces + 1, sizeof *m.input);
    m.work = app_keep(lg_model_work_size(file->model), 1);
    if (!*none) write_model(&m);
    export_evaluation_close(&m.probability);
    lg_program_destroy(m.program);
}
