/* Reads grids of runs: the keys of a study, which stand beside the keys of a scene. */
#include <string.h>

#include "files/h5.h"
#include "hamiltonian/files/recipe.h"
#include "settings/training.h"
#include "mechanics/files/scene.h"

#define LISTS LG_GRID_VALUES
#define FORM  "hamiltonian" /* the form of the systems that a grid learns */

/* The grid's own keys. list_keys sets the limits of penalty and substeps to the hyperparameters' limits. */
const lg_field lg_grid_keys[] = {
    {.name = "integrators",
     .option = "schemes",
     .type = LG_FIELD_NAMES,
     .required = true,
     .most = LISTS,
     .value_name = lg_name_scheme},
    LG_FIELD(lg_grid, NULL, "penalty", REALS, penalty, .most = LISTS),
    LG_FIELD(lg_grid, NULL, "substeps", WHOLES, substeps, .most = LISTS),
    LG_FIELD(lg_grid, NULL, "N", WHOLES, n, .required = true, .low = 1, .high = 1e9, .most = LISTS),
    LG_FIELD(lg_grid, NULL, "M", WHOLES, m, .required = true, .low = 2, .high = 1e9, .most = LISTS),
    LG_FIELD(lg_grid, NULL, "eps", REALS, eps, .high = 1e6, .most = LISTS),
    LG_FIELD(lg_grid, NULL, "repeats", U32, repeats, .low = 1, .high = 1e6),
    LG_FIELD(lg_grid, NULL, "noise_kind", NAME, noise_kind, LG_NAMES("normal", "uniform")),
    LG_FIELD(lg_grid, NULL, "seed", U64, seed, .high = 0x1p64),
    LG_MAP("test"),
    LG_FIELD(lg_grid, NULL, "test.trajectories", U32, test_trajectories, .low = 1, .high = 1e9),
    LG_FIELD(lg_grid, NULL, "test.points", U32, test_points, .low = 2, .high = 1e9),
    LG_FIELD_END};

enum { OWN_KEYS = LG_COUNT(lg_grid_keys) - 1 };

bool lg_grid_shares(const lg_field *row) {
    static const char *const varied[] = {"integrator", "penalty", "substeps", "seed"};
    for (size_t i = 0; i < LG_COUNT(varied); i++)
        if (strcmp(varied[i], row->name) == 0) return false;
    return true;
}

/* All keys: the grid's own, then the hyperparameters that all runs share. */
enum { KEYS = 48 };
typedef struct grid_keys {
    lg_field keys[KEYS];
    size_t count;
} grid_keys;

static void list_keys(grid_keys *out) {
    memcpy(out->keys, lg_grid_keys, OWN_KEYS * sizeof *lg_grid_keys);
    for (lg_field *key = out->keys; key < out->keys + OWN_KEYS; key++) {
        const lg_field *row = lg_field_find(lg_hamiltonian_fields, key->name);
        const bool varied = strcmp(key->name, "penalty") == 0 || strcmp(key->name, "substeps") == 0;
        if (varied) key->low = row->low, key->high = row->high;
    }
    out->count = OWN_KEYS;
    for (const lg_field *row = lg_hamiltonian_fields; row->name != NULL; row++) {
        if (lg_grid_shares(row) && out->count < KEYS) out->keys[out->count++] = *row;
    }
}

/* Keys of a grid whose scene is in another file. */
enum { FILE_KEYS = 2 };
static const lg_field file_keys[FILE_KEYS] = {
    {.name = "scene", .type = LG_FIELD_TEXT, .required = true},
    LG_FIELD(lg_grid, NULL, "t_end", REAL, t_end, .above = true, .high = 1e12),
};

static lg_status fill(lg_yaml *yaml, const grid_keys *keys, const lg_key_value *v, lg_grid *out,
                      lg_error *error) {
    *out = (lg_grid){.scene = out->scene,
                     .eps = {.count = 1},
                     .penalty = {.count = 1},
                     .substeps = {1, {1}},
                     .repeats = 1,
                     .test_trajectories = 100,
                     .test_points = 15,
                     .seed = 1};
    lg_fields_default(lg_hamiltonian_fields, &out->run);
    const lg_key_value *schemes = lg_yaml_value(keys->keys, v, "integrators");
    out->integrator_count = schemes->count;
    for (uint32_t i = 0; i < out->integrator_count; i++)
        out->integrators[i] = lg_scheme_at((size_t)schemes->real[i]);
    LG_TRY(lg_yaml_store(yaml, keys->keys, v, OWN_KEYS, out, error));
    return lg_yaml_store(yaml, keys->keys + OWN_KEYS, v + OWN_KEYS, keys->count - OWN_KEYS, &out->run, error);
}

/* The path of a file that the grid names; a relative path starts from the folder of the grid. */
static lg_status path_in(const lg_yaml *yaml, const char *name, lg_text *out, lg_error *error) {
    const char *path = lg_yaml_path(yaml), *slash = strrchr(path, '/');
    const int folder = slash == NULL || name[0] == '/' ? 0 : (int)(slash - path) + 1;
    lg_text_add(out, "%.*s%s", folder, path, name);
    return out->failed ? lg_no_memory_for(path, error) : LG_OK;
}

/* Reads the file of key `scene`. */
static lg_status read_scene_file(const lg_context *context, const lg_yaml *yaml, const lg_key_value *value,
                                 lg_scene *out, lg_error *error) {
    LG_CLEAN(lg_text_destroy) lg_text joined = {.context = context};
    lg_error inner = {LG_OK, ""};
    LG_TRY(path_in(yaml, value->text, &joined, error));
    const lg_status status = lg_scene_read(context, joined.data, FORM, out, &inner);
    if (status == LG_OK) return LG_OK;
    return lg_fail(error, status, "%s: line %u: scene: %.300s", lg_shown_path(lg_yaml_path(yaml)),
                   value->line, inner.message);
}

/* A first integral in a file is relative to the grid, too. */
static lg_status place_integral(const lg_context *context, const lg_yaml *yaml, lg_hamiltonian_run *run,
                                lg_error *error) {
    LG_CLEAN(lg_text_destroy) lg_text joined = {.context = context};
    lg_error inner = {LG_OK, ""};
    if (lg_first_integral_find(run->penalty_integral) != NULL) return LG_OK;
    LG_TRY(path_in(yaml, run->penalty_integral, &joined, error));
    if (lg_field_set(lg_field_find(lg_hamiltonian_fields, "penalty_integral"), joined.data, run, &inner) ==
        LG_OK)
        return LG_OK;
    return lg_fail(error, LG_FORMAT, "%s: penalty_integral: %.300s", lg_shown_path(lg_yaml_path(yaml)),
                   inner.message);
}

static lg_status read_grid(const lg_context *context, lg_yaml *yaml, const grid_keys *keys,
                           lg_key_value *values, lg_grid *out, lg_error *error) {
    lg_key_value *in_file = values + KEYS;
    lg_key_set sets[2] = {{keys->keys, keys->count, values}, {file_keys, FILE_KEYS, in_file}};
    bool own_file = lg_yaml_has(yaml, "scene");
    if (!own_file && !lg_yaml_has(yaml, "system"))
        return lg_yaml_fail(yaml, 1, LG_FORMAT, error, "key 'scene' or 'system' is missing");
    if (own_file) {
        LG_TRY(lg_yaml_read(yaml, sets, 2, NULL, "", error));
        LG_TRY(
            read_scene_file(context, yaml, lg_yaml_value(file_keys, in_file, "scene"), &out->scene, error));
    } else {
        LG_TRY(lg_scene_from(context, yaml, FORM, sets, &out->scene, error));
    }
    LG_TRY(fill(yaml, keys, values, out, error));
    LG_TRY(place_integral(context, yaml, &out->run, error));
    out->t_end = out->scene.t_end;
    if (own_file) LG_TRY(lg_yaml_store(yaml, file_keys, in_file, FILE_KEYS, out, error));
    if (out->t_end > 0) return LG_OK;
    return lg_yaml_fail(yaml, 1, LG_FORMAT, error, "key 't_end' is missing, here and in the scene");
}

lg_status lg_grid_read(const lg_context *context, const char *path, lg_grid *out, lg_error *error) {
    LG_CLEAN(lg_yaml_close_at) lg_yaml *yaml = NULL;
    grid_keys keys;
    LG_CLEAN(lg_grid_destroy) lg_grid made = {.repeats = 0};
    if (out == NULL) return lg_fail(error, LG_INVALID_ARGUMENT, "the place for the grid is NULL");
    LG_TRY(lg_yaml_open(context, path, &yaml, error));
    list_keys(&keys);
    LG_SCRATCH(lg_key_value, values, context, KEYS + FILE_KEYS);
    if (values == NULL) return lg_no_memory_for(path, error);
    LG_TRY(read_grid(context, yaml, &keys, values, &made, error));
    return LG_GIVE(out, made);
}

void lg_grid_destroy(lg_grid *grid) {
    if (grid == NULL) return;
    lg_scene_destroy(&grid->scene);
    *grid = (lg_grid){.repeats = 0};
}
