#include "datasets/run.h"

#include <math.h>
#include <stdio.h>
#include <string.h>

#include "datasets/names.h"

/* ---- one table for saving, loading and comparing ---- */

typedef enum row_type { ROW_REAL, ROW_U64, ROW_U32, ROW_TEXT, ROW_NAME } row_type;

typedef struct row {
    const char *group, *name;
    row_type type;
    size_t offset, size;                 /* in lg_hamiltonian_run */
    double low;                          /* smallest value of a number */
    const char *(*value_name)(uint32_t); /* ROW_NAME: NULL beyond the last */
} row;

#define FIELD(member) offsetof(lg_hamiltonian_run, member), sizeof(((lg_hamiltonian_run *)0)->member)

static const row rows[] = {
    {"model", "family", ROW_NAME, FIELD(model.family), 0, lg_name_family},
    {"model", "links", ROW_U32, FIELD(model.links), 1, NULL},
    {"model", "potential", ROW_NAME, FIELD(model.potential), 0, lg_name_potential},
    {"model", "activation", ROW_NAME, FIELD(model.net.activation), 0, lg_name_activation},
    {"run", "dtype", ROW_NAME, FIELD(dtype), 0, lg_name_dtype},
    {"run", "system", ROW_TEXT, FIELD(system), 0, NULL},
    {"run", "integrator", ROW_NAME, FIELD(integrator), 0, lg_name_integrator},
    {"run", "substeps", ROW_U32, FIELD(substeps), 1, NULL},
    {"run", "penalty", ROW_REAL, FIELD(penalty), 0, NULL},
    {"run", "penalty_form", ROW_NAME, FIELD(penalty_form), 0, lg_name_penalty_form},
    {"run", "epochs", ROW_U64, FIELD(epochs), 0, NULL},
    {"run", "batch", ROW_U64, FIELD(batch), 0, NULL},
    {"run", "lr", ROW_REAL, FIELD(lr), 0, NULL},
    {"run", "lr_step", ROW_U64, FIELD(lr_step), 0, NULL},
    {"run", "lr_gamma", ROW_REAL, FIELD(lr_gamma), 0, NULL},
    {"run", "weight_decay", ROW_REAL, FIELD(weight_decay), 0, NULL},
    {"run", "adam_eps", ROW_REAL, FIELD(adam_eps), 0, NULL},
    {"run", "clip", ROW_REAL, FIELD(clip), 0, NULL},
    {"run", "validation", ROW_REAL, FIELD(validation), 0, NULL},
    {"run", "shards", ROW_U32, FIELD(shards), 1, NULL},
    {"run", "seed", ROW_U64, FIELD(seed), 0, NULL},
    {"run", "trajectories", ROW_U64, FIELD(trajectories), 0, NULL},
    {"run", "points", ROW_U64, FIELD(points), 0, NULL},
    {"run", "dt", ROW_REAL, FIELD(dt), 0, NULL},
    {"run", "data_sha256", ROW_TEXT, FIELD(data_sha256), 0, NULL},
};

typedef struct row_value {
    double real;
    uint64_t whole;
    const char *text; /* NULL for a name beyond the list */
} row_value;

_Static_assert(sizeof(lg_dtype) == sizeof(uint32_t) && sizeof(lg_activation) == sizeof(uint32_t) &&
                   sizeof(lg_train_integrator) == sizeof(uint32_t),
               "enumerations are read through their representation");

static row_value value_of(const row *r, const lg_hamiltonian_run *run) {
    const char *at = (const char *)run + r->offset;
    row_value value = {0, 0, ""};
    uint32_t narrow = 0;
    switch (r->type) {
    case ROW_REAL:
        memcpy(&value.real, at, sizeof value.real);
        break;
    case ROW_U64:
        memcpy(&value.whole, at, sizeof value.whole);
        break;
    case ROW_U32:
        memcpy(&narrow, at, sizeof narrow);
        value.whole = narrow;
        break;
    case ROW_TEXT:
        value.text = at;
        break;
    case ROW_NAME:
        memcpy(&narrow, at, sizeof narrow);
        value.text = r->value_name(narrow);
        break;
    }
    return value;
}

static const char *place_name(const row *r, char *text, size_t size) {
    (void)snprintf(text, size, "/%s: attribute %s", r->group, r->name);
    return text;
}

static lg_status check_row(const char *path, const row *r, const lg_hamiltonian_run *run, lg_status status,
                           lg_error *error) {
    char place[64];
    row_value value = value_of(r, run);
    if (r->type == ROW_REAL && !isfinite(value.real))
        return lg_fail(error, LG_NOT_FINITE, "%s: %s is not finite", lg_shown_path(path),
                       place_name(r, place, sizeof place));
    bool small = (r->type == ROW_REAL && value.real < r->low) ||
                 ((r->type == ROW_U64 || r->type == ROW_U32) && (double)value.whole < r->low);
    if (small || value.text == NULL)
        return lg_fail(error, status, "%s: %s is out of range", lg_shown_path(path),
                       place_name(r, place, sizeof place));
    return LG_OK;
}

/* ---- the network ---- */

static uint32_t hidden_layers(const lg_hamiltonian *model) {
    return model->net.layers > 0 && model->net.layers <= LG_MLP_MAX_LAYERS ? model->net.layers - 1 : 0;
}

/* "100,100,100", as on the command line */
static void hidden_text(const lg_hamiltonian *model, char *text, size_t size) {
    size_t used = 0;
    text[0] = '\0';
    for (uint32_t i = 1; i <= hidden_layers(model) && used < size; i++)
        used += (size_t)snprintf(text + used, size - used, "%s%u", i > 1 ? "," : "", model->net.width[i]);
}

static bool parse_hidden(const char *text, uint32_t *hidden, uint32_t *count) {
    *count = 0;
    while (*text != '\0') {
        char part[16];
        uint64_t value;
        size_t length = strcspn(text, ",");
        if (length >= sizeof part || *count >= LG_MLP_MAX_LAYERS - 1) return false;
        memcpy(part, text, length);
        part[length] = '\0';
        if (lg_integer_parse(part, &value) != LG_OK || value > UINT32_MAX) return false;
        hidden[(*count)++] = (uint32_t)value;
        text += length;
        if (*text == ',' && *++text == '\0') return false;
    }
    return true;
}

/* ---- outside ---- */

lg_status lg_run_check(const char *path, const lg_hamiltonian_run *run, lg_error *error) {
    lg_hamiltonian again;
    for (size_t i = 0; i < LG_COUNT(rows); i++)
        LG_TRY(check_row(path, &rows[i], run, LG_INVALID_ARGUMENT, error));
    lg_status status =
        lg_hamiltonian_init(&again, run->model.family, run->model.links, run->model.potential,
                            run->model.net.width + 1, hidden_layers(&run->model), run->model.net.activation);
    if (status == LG_OK && lg_hamiltonian_parameters(&again) != lg_hamiltonian_parameters(&run->model))
        status = LG_INVALID_ARGUMENT;
    if (status != LG_OK)
        return lg_fail(error, status, "%s: the model was not made by lg_hamiltonian_init",
                       lg_shown_path(path));
    return LG_OK;
}

lg_status lg_run_put(lg_h5 *h5, const lg_hamiltonian_run *run, lg_error *error) {
    char text[LG_LAYOUT_TEXT];
    for (size_t i = 0; i < LG_COUNT(rows); i++) {
        const row *r = &rows[i];
        row_value value = value_of(r, run);
        lg_status status;
        if (r->type == ROW_REAL)
            status = lg_h5_put_number(h5, r->group, r->name, LG_ELEMENT_F64, &value.real, error);
        else if (r->type == ROW_U64 || r->type == ROW_U32)
            status = lg_h5_put_number(h5, r->group, r->name, LG_ELEMENT_U64, &value.whole, error);
        else
            status = lg_h5_put_text(h5, r->group, r->name, value.text, error);
        if (status != LG_OK) return status;
    }
    bool chain = run->model.family == LG_HAMILTONIAN_CHAIN;
    hidden_text(&run->model, text, sizeof text);
    LG_TRY(lg_h5_put_text(h5, "model", "hidden", text, error));
    lg_layout_text(run->model.family, run->model.links, text);
    LG_TRY(lg_h5_put_text(h5, "model", "inputs", text, error));
    LG_TRY(lg_h5_put_text(h5, "model", "input_units", chain ? "q: 1, p: kg m^2/s" : "q: 1, p: 1", error));
    LG_TRY(lg_h5_put_text(h5, "model", "outputs", "H", error));
    return lg_h5_put_text(h5, "model", "output_units", chain ? "J" : "1", error);
}

static lg_status attribute_format(lg_h5 *h5, const row *r, const char *what, lg_error *error) {
    char place[64];
    return lg_fail(error, LG_FORMAT, "%s: %s %s", lg_shown_path(h5->path), place_name(r, place, sizeof place),
                   what);
}

static lg_status get_name(lg_h5 *h5, const row *r, void *at, lg_error *error) {
    char text[64];
    lg_status status = lg_h5_text(h5, r->group, r->name, text, sizeof text, error);
    if (status != LG_OK && status != LG_SHAPE) return status;
    uint32_t value = 0;
    const char *name = status == LG_OK ? r->value_name(0) : NULL;
    while (name != NULL && strcmp(name, text) != 0) name = r->value_name(++value);
    if (name == NULL) return attribute_format(h5, r, "is not a known name", error);
    memcpy(at, &value, sizeof value);
    return LG_OK;
}

static lg_status get_row(lg_h5 *h5, const row *r, lg_hamiltonian_run *run, lg_error *error) {
    char *at = (char *)run + r->offset;
    lg_status status = LG_OK;
    switch (r->type) {
    case ROW_REAL:
        status = lg_h5_number(h5, r->group, r->name, LG_ELEMENT_F64, at, error);
        break;
    case ROW_U64:
        status = lg_h5_number(h5, r->group, r->name, LG_ELEMENT_U64, at, error);
        break;
    case ROW_U32:
        status = lg_h5_number(h5, r->group, r->name, LG_ELEMENT_U32, at, error);
        break;
    case ROW_NAME:
        status = get_name(h5, r, at, error);
        break;
    case ROW_TEXT:
        status = lg_h5_text(h5, r->group, r->name, at, r->size, error);
        if (status == LG_SHAPE) status = attribute_format(h5, r, "is too long", error);
        break;
    }
    if (status != LG_OK) return status;
    return check_row(h5->path, r, run, LG_FORMAT, error);
}

lg_status lg_run_get(lg_h5 *h5, bool complete, lg_hamiltonian_run *run, lg_error *error) {
    char text[LG_H5_TEXT];
    uint32_t hidden[LG_MLP_MAX_LAYERS], count;
    lg_hamiltonian_run got = {.substeps = 1, .shards = 4};
    const char *shown = lg_shown_path(h5->path);
    for (size_t i = 0; i < LG_COUNT(rows); i++) {
        bool needed = complete || strcmp(rows[i].group, "model") == 0;
        if (!needed && !lg_h5_has_attribute(h5, rows[i].group, rows[i].name)) continue;
        LG_TRY(lg_missing_is_format(get_row(h5, &rows[i], &got, error), error));
    }
    lg_status status = lg_h5_text(h5, "model", "hidden", text, sizeof text, error);
    if (status != LG_OK && status != LG_SHAPE) return lg_missing_is_format(status, error);
    if (status == LG_SHAPE || !parse_hidden(text, hidden, &count))
        return lg_fail(error, LG_FORMAT, "%s: /model: attribute hidden: expected widths as '100,100,100'",
                       shown);
    status = lg_hamiltonian_init(&got.model, got.model.family, got.model.links, got.model.potential, hidden,
                                 count, got.model.net.activation);
    if (status != LG_OK)
        return lg_fail(error, LG_FORMAT, "%s: /model: attributes links and hidden are out of range", shown);
    *run = got;
    return LG_OK;
}

/* A value as it stands in a sentence. */
static void show_row(const row *r, const lg_hamiltonian_run *run, char *text, size_t size) {
    row_value value = value_of(r, run);
    if (r->type == ROW_REAL)
        (void)snprintf(text, size, "%.17g", value.real);
    else if (r->type == ROW_U64 || r->type == ROW_U32)
        (void)snprintf(text, size, "%llu", (unsigned long long)value.whole);
    else
        (void)snprintf(text, size, "%s", value.text != NULL ? value.text : "?");
}

lg_status lg_hamiltonian_run_compare(const char *path, const lg_hamiltonian_run *stored,
                                     const lg_hamiltonian_run *wanted, lg_error *error) {
    char have[256], want[256];
    if (path == NULL || stored == NULL || wanted == NULL) return LG_INVALID_ARGUMENT;
    for (size_t i = 0; i < LG_COUNT(rows); i++) {
        show_row(&rows[i], stored, have, sizeof have);
        show_row(&rows[i], wanted, want, sizeof want);
        if (strcmp(have, want) != 0)
            return lg_fail(error, LG_INVALID_ARGUMENT, "%s: was written with %s %s, not %s",
                           lg_shown_path(path), rows[i].name, have, want);
    }
    hidden_text(&stored->model, have, sizeof have);
    hidden_text(&wanted->model, want, sizeof want);
    if (strcmp(have, want) != 0)
        return lg_fail(error, LG_INVALID_ARGUMENT, "%s: was written with hidden %s, not %s",
                       lg_shown_path(path), have, want);
    return LG_OK;
}
