/* What differs between the members of an ensemble: distributions of parameters and starts, or the rows of a
 * table. The numbers of member i depend only on the seed and i. */
#include "lg-simulate/ensemble.h"

#include <math.h>
#include <string.h>

#include "liegrad/geometry.h"
#include "liegrad/table.h"

/* ---- names of the numbers ---- */

void component_name(const simulation *sim, size_t index, char *text, size_t size) {
    if (index >= sim->dim) lg_system_parameter_label(sim->system, index - sim->dim, text);
    for (size_t i = 0; i < sim->block_count; i++) {
        const block *at = &sim->blocks[i];
        if (index < at->offset || index >= at->offset + at->count) continue;
        char name[32], part[24];
        block_name(at, name, sizeof name);
        block_part(at, index - at->offset, part, sizeof part);
        (void)snprintf(text, size, "%s%s%s", name, part[0] != '\0' ? "." : "", part);
        return;
    }
    if (index < sim->dim) (void)snprintf(text, size, "y%zu", index + 1);
}

bool component_find(const simulation *sim, const char *name, size_t *index) {
    char own[64];
    for (size_t i = 0; i < sim->dim + lg_system_parameter_count(sim->system); i++) {
        component_name(sim, i, own, sizeof own);
        const bool reported = i < sim->reported || i >= sim->dim;
        if (reported && strcmp(own, name) == 0) return *index = i, true;
    }
    return false;
}

/* ---- distributions ---- */

typedef enum distribution {
    UNIFORM,  /* uniform from LOW to HIGH, its two numbers */
    NORMAL,   /* normal with MEAN and DEVIATION, its two numbers */
    WITHIN,   /* the scene's value + s U(-1, 1) */
    AROUND,   /* the scene's value + s N(0, 1) */
    SPHERE,   /* a direction, uniform on the sphere */
    CONE,     /* a direction within an angle of the scene's direction, uniform on this cap */
    ROTATION, /* a rotation, uniform on SO(3) */
    DISTRIBUTIONS
} distribution;

static const struct {
    const char *name;
    /* numbers: how many numbers follow the name; block: how many consecutive numbers are drawn, 0 for any. */
    size_t numbers, block;
    const char *usage;
} distributions[DISTRIBUTIONS] = {[UNIFORM] = {"uniform", 2, 0, "uniform LOW HIGH"},
                                  [NORMAL] = {"normal", 2, 0, "normal MEAN DEVIATION"},
                                  [WITHIN] = {"within", 1, 0, "within S or S%"},
                                  [AROUND] = {"around", 1, 0, "around S or S%"},
                                  [SPHERE] = {"sphere", 0, 3, "sphere"},
                                  [CONE] = {"cone", 1, 3, "cone ANGLE"},
                                  [ROTATION] = {"rotation", 0, 9, "rotation"}};

/* One item of --vary: consecutive components, from `offset` on, and their distribution. */
typedef struct vary_item {
    size_t offset, count;
    distribution kind;
    double value[2];
    bool percent;
} vary_item;

struct vary {
    const simulation *sim;
    uint64_t seed;
    size_t count;
    vary_item *items;    /* room for all blocks in each item of --vary */
    lg_table_data table; /* the table of --members */
    size_t *column;      /* the component of each column */
    /* whether any item or column is for the state; for a parameter */
    bool of_state, of_parameters;
};

static void note_component(vary *self, size_t component) {
    *(component < self->sim->dim ? &self->of_state : &self->of_parameters) = true;
}

static void add_item(vary *self, vary_item item, size_t offset, size_t count) {
    item.offset = offset;
    item.count = count;
    self->items[self->count++] = item;
    note_component(self, offset);
}

/* Adds all numbers with this name: a parameter or one number of it, all blocks with a key, a block, or a
 * component. */
static bool add_named(vary *self, const vary_item *item, const char *name) {
    const simulation *sim = self->sim;
    size_t count = 0, index = 0;
    const double *values = parameter_values(sim, name, &count);
    const size_t before = self->count;
    if (values != NULL) {
        const size_t at = (size_t)(values - lg_system_parameter_values(sim->system));
        add_item(self, *item, sim->dim + at, count);
        return true;
    }
    for (size_t i = 0; i < sim->block_count; i++) {
        char own[64];
        block_name(&sim->blocks[i], own, sizeof own);
        if (strcmp(sim->blocks[i].key, name) == 0 || strcmp(own, name) == 0)
            add_item(self, *item, sim->blocks[i].offset, sim->blocks[i].count);
    }
    if (self->count > before) return true;
    if (component_find(sim, name, &index)) add_item(self, *item, index, 1);
    return self->count > before;
}

/* ---- reading the options ---- */

static void refuse_name(const simulation *sim, const char *option, const char *name) {
    char own[64];
    lg_name_list known = {.used = 0};
    for (size_t i = 0; i < lg_system_parameter_count(sim->system) && i < 8; i++) {
        component_name(sim, sim->dim + i, own, sizeof own);
        lg_name_list_add(&known, own);
    }
    component_name(sim, 0, own, sizeof own);
    app_stop_usage(sim->self,
                   "--%s: '%s' is neither a parameter (%s), nor a part of the state (%s), nor one of "
                   "its numbers (%s)",
                   option, name, known.text, lg_system_layout(sim->system), own);
}

char *trimmed(char *text) {
    while (*text == ' ') text++;
    for (size_t n = strlen(text); n > 0 && text[n - 1] == ' '; n--) text[n - 1] = '\0';
    return text;
}

/* Reads "normal 0 1", or without blanks "normal:0:1". */
static vary_item read_distribution(const simulation *sim, char *text) {
    char *rest = NULL;
    const char *word = strtok_r(text, " :", &rest);
    int kind = 0;
    while (kind < DISTRIBUTIONS && (word == NULL || strcmp(distributions[kind].name, word) != 0)) kind++;
    if (kind == DISTRIBUTIONS)
        app_stop_usage(
            sim->self,
            "--vary: '%s' is not one of uniform LOW HIGH, normal MEAN DEVIATION, within S, within S%%, "
            "around S, around S%%, sphere, cone ANGLE, rotation",
            word != NULL ? word : "");
    vary_item item = {.kind = (distribution)kind};
    for (size_t i = 0; i < distributions[kind].numbers; i++) {
        char *number = strtok_r(NULL, " :", &rest);
        const size_t length = number != NULL ? strlen(number) : 0;
        if ((kind == WITHIN || kind == AROUND) && length > 0 && number[length - 1] == '%') {
            item.percent = true;
            number[length - 1] = '\0';
        }
        if (number == NULL || lg_number_parse(number, &item.value[i]) != LG_OK)
            app_stop_usage(sim->self, "--vary: expected '%s'", distributions[kind].usage);
    }
    const bool ordered = kind != UNIFORM || item.value[0] <= item.value[1];
    const double size = item.value[kind == NORMAL];
    if (strtok_r(NULL, " :", &rest) != NULL || !ordered || (kind != UNIFORM && size < 0))
        app_stop_usage(sim->self,
                       "--vary: expected '%s', with LOW <= HIGH, sizes of 0 or more, and nothing after it",
                       distributions[kind].usage);
    return item;
}

static void read_item(vary *self, char *text) {
    const simulation *sim = self->sim;
    char *equal = strchr(text, '=');
    if (equal == NULL)
        app_stop_usage(sim->self, "--vary: expected NAME = DISTRIBUTION, ..., found '%s'", trimmed(text));
    *equal = '\0';
    const char *name = trimmed(text);
    const vary_item item = read_distribution(sim, trimmed(equal + 1));
    const size_t before = self->count, block_size = distributions[item.kind].block;
    if (!add_named(self, &item, name)) refuse_name(sim, "vary", name);
    for (size_t i = before; i < self->count; i++)
        if (block_size > 0 && self->items[i].count != block_size)
            app_stop_usage(sim->self,
                           "--vary: %s: '%s' is for vectors or matrices of %zu numbers, not of %zu", name,
                           distributions[item.kind].name, block_size, self->items[i].count);
    const bool relative = item.kind == WITHIN || item.kind == AROUND || item.kind == CONE;
    if (relative && self->items[before].offset < sim->dim && !sim->scene.has_initial)
        app_stop_usage(sim->self, "--vary: %s: '%s' needs a value in the scene: give the key `initial`", name,
                       distributions[item.kind].name);
}

/* Finds the destinations of the table's columns by their names. */
static void read_table(vary *self, const char *path) {
    const simulation *sim = self->sim;
    APP_CLEAN(lg_table_names_destroy) lg_table_names names = {.count = 0};
    APP_FILE(sim->self, path, lg_table_names_read, NULL, &names);
    APP_FREE const char **chosen = app_alloc(names.count, sizeof *chosen);
    self->column = app_keep(names.count, sizeof *self->column);
    for (uint32_t i = 0; i < names.count; i++) {
        chosen[i] = names.name[i];
        if (!component_find(sim, chosen[i], &self->column[i])) refuse_name(sim, "members", chosen[i]);
        note_component(self, self->column[i]);
    }
    APP_FILE(sim->self, path, lg_table_read, chosen, names.count, NULL, NULL, &self->table);
    const lg_table_data *t = &self->table;
    for (size_t i = 0; i < t->rows * t->columns; i++)
        if (isnan(t->values[i]))
            app_stop(sim->self, LG_FORMAT, "%s: %s %zu: column %s: the value is missing", path, t->place,
                     t->line[i / t->columns], chosen[i % t->columns]);
}

vary *vary_open(const simulation *sim, const char *text, const char *table, size_t *rows, bool *parameters) {
    vary *self = app_keep(1, sizeof *self);
    APP_FREE char *copy = app_format("%s", text);
    *self = (vary){.sim = sim, .seed = sim->self->seed};
    size_t given = 1;
    for (const char *at = text; *at != '\0'; at++) given += *at == ',';
    self->items = app_keep(given * (sim->block_count + 1), sizeof *self->items);
    for (char *rest = copy, *item; (item = strtok_r(rest, ",", &rest)) != NULL;) read_item(self, item);
    if (table != NULL) read_table(self, table);
    *rows = self->table.rows;
    *parameters = self->of_parameters;
    return self;
}

void vary_close(vary *self) {
    if (self != NULL) lg_table_data_destroy(&self->table);
}

/* ---- drawing numbers ---- */

static void draw_direction(lg_rng *rng, double *x) {
    for (double size = 0; !(size > 1e-6);) {
        for (int c = 0; c < 3; c++) x[c] = lg_rng_normal(rng);
        size = sqrt(lg_dot3(x, x));
        for (int c = 0; c < 3; c++) x[c] /= size;
    }
}

/* Draws a direction, uniform on the cap around x: the cosine is uniform. */
static void draw_cone(lg_rng *rng, double angle, double *x) {
    double side[3], turn[3];
    const double cosine = 1.0 - lg_rng_uniform(rng) * (1.0 - cos(fmin(angle, 3.14159265358979323846)));
    const double tilt = acos(cosine);
    draw_direction(rng, side);
    lg_cross3(x, side, turn);
    const double size = sqrt(lg_dot3(turn, turn));
    for (int c = 0; c < 3 && size > 0.0; c++) turn[c] *= tilt / size;
    if (size > 0.0) lg_so3_exp_act(turn, x, x);
}

static void draw_rotation(lg_rng *rng, double *R) {
    lg_space space;
    (void)lg_space_init(&space, &(lg_space_factor){LG_SPACE_SO3, 1}, 1);
    (void)lg_space_draw_start(&space, NULL, rng, R);
}

static double draw_number(lg_rng *rng, const vary_item *item, double own) {
    const double size = item->percent ? 0.01 * item->value[0] * fabs(own) : item->value[0];
    switch (item->kind) {
    case UNIFORM:
        return lg_rng_uniform_in(rng, item->value[0], item->value[1]);
    case NORMAL:
        return item->value[0] + item->value[1] * lg_rng_normal(rng);
    case WITHIN:
        return own + size * lg_rng_uniform_in(rng, -1.0, 1.0);
    default:
        return own + size * lg_rng_normal(rng);
    }
}

static double *number_at(const simulation *sim, size_t component, double *y0, double *parameters) {
    return component < sim->dim ? y0 + component : parameters + (component - sim->dim);
}

lg_status vary_draw(void *user, uint64_t member, double *y0, double *parameters) {
    const vary *self = user;
    const simulation *sim = self->sim;
    lg_rng rng;
    lg_rng_seed(&rng, self->seed, member);
    if (!sim->scene.has_initial && !self->of_state) {
        lg_trajectory_options starts;
        lg_trajectory_options_init(&starts);
        starts.starts = sim->scene.starts;
        starts.low = sim->scene.low;
        starts.high = sim->scene.high;
        LG_TRY(lg_system_draw_start(sim->system, &starts, &rng, y0));
    }
    for (size_t i = 0; i < self->count; i++) {
        const vary_item *item = &self->items[i];
        double *x = number_at(sim, item->offset, y0, parameters);
        if (item->kind == SPHERE)
            draw_direction(&rng, x);
        else if (item->kind == CONE)
            draw_cone(&rng, item->value[0], x);
        else if (item->kind == ROTATION)
            draw_rotation(&rng, x);
        else
            for (size_t k = 0; k < item->count; k++) x[k] = draw_number(&rng, item, x[k]);
    }
    for (uint32_t c = 0; c < self->table.columns; c++)
        *number_at(sim, self->column[c], y0, parameters) =
            self->table.values[(size_t)member * self->table.columns + c];
    /* Numbers were drawn one by one, so the state is projected onto the manifold: directions get length 1,
     * omega becomes orthogonal to q. */
    if (self->of_state && self->table.rows == 0) lg_space_project(lg_system_space(sim->system), y0);
    return LG_OK;
}
