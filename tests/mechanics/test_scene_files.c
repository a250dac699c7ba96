/* Scene and grid files: every key, tables of invalid input, the scenes that the project ships. */
#include <stdarg.h>

#include "support/io_test.h"

#include "liegrad/geometry.h"
#include "liegrad/hamiltonian.h"

static const char good_scene[] = "# a comment\n"                  /* 1 */
                                 "system: pendulum-chain\n"       /* 2 */
                                 "form: hamiltonian\n"            /* 3 */
                                 "gravity: 9.81\n"                /* 4 */
                                 "masses: [1, 1.3]\n"             /* 5 */
                                 "lengths: [1, 0.8]\n"            /* 6 */
                                 "initial:\n"                     /* 7 */
                                 "  q: [[0.6, 0, 0.8],\n"         /* 8 */
                                 "      [0, 1, 0]]\n"             /* 9 */
                                 "  p: [[0, 2, 0], [1, 0, -3]]\n" /* 10 */
                                 "t_end: 3\n";                    /* 11 */

static const char json_scene[] = "{\"system\": \"pendulum-chain\", \"form\": \"lagrangian\",\n"
                                 " \"gravity\": -9.81e0, \"links\": 1,\n"
                                 " \"initial\": {\"q\": [[0, 0, -1]], \"omega\": [[1, 2, 0]]},\n"
                                 " \"t_end\": 2.5}\n";

static const char good_grid[] = "scene: scene.yaml\n"                  /* 1 */
                                "integrators: [cf4, rk4]\n"            /* 2 */
                                "N: [50, 500]\n"                       /* 3 */
                                "M: 5\n"                               /* 4 */
                                "eps: [0, 1e-3, 0.1]\n"                /* 5 */
                                "penalty: [0, 1e-3]\n"                 /* 6 */
                                "substeps: [1, 2]\n"                   /* 7 */
                                "repeats: 5\n"                         /* 8 */
                                "hidden: [30, 30]\n"                   /* 9 */
                                "dtype: f32\n"                         /* 10 */
                                "test: {trajectories: 7, points: 9}\n" /* 11 */
                                "seed: 18446744073709551615\n"         /* 12 */
                                "t_end: 0.1\n";                        /* 13 */

static lg_status read_scene(const lg_context *context, const char *path, const lg_read_options *options,
                            lg_error *error) {
    (void)options;
    lg_scene scene;
    const lg_status status = lg_scene_read(context, path, NULL, &scene, error);
    if (status == LG_OK) lg_scene_destroy(&scene);
    return status;
}

static lg_status read_grid(const lg_context *context, const char *path, const lg_read_options *options,
                           lg_error *error) {
    (void)options;
    lg_grid grid;
    const lg_status status = lg_grid_read(context, path, &grid, error);
    if (status == LG_OK) lg_grid_destroy(&grid);
    return status;
}

static const char *file_of(const char *name, const char *text) {
    const char *path = scratch_path(name);
    write_text_to(path, text);
    return path;
}

/* `text` with `from`, which must occur, replaced by `to`. */
static const char *changed(const char *name, const char *text, const char *from, const char *to) {
    const char *at = strstr(text, from);
    assert_non_null(at);
    return file_of(name, test_text("%.*s%s%s", (int)(at - text), text, to, at + strlen(from)));
}

OWNED(lg_scene, lg_scene_destroy)
OWNED(lg_grid, lg_grid_destroy)

/* `form_wanted` may be NULL. */
static lg_scene read_form(const char *path, const char *form_wanted) {
    lg_scene scene;
    assert_told(lg_scene_read(NULL, path, form_wanted, &scene, &told));
    return *own_lg_scene(scene);
}

static lg_scene read_text(const char *name, const char *text, const char *form_wanted) {
    return read_form(file_of(name, text), form_wanted);
}

static lg_grid read_good_grid(const char *path) {
    lg_grid grid;
    assert_told(lg_grid_read(NULL, path, &grid, &told));
    return *own_lg_grid(grid);
}

/* The state must begin with these numbers. */
static void assert_state(const lg_scene *scene, const double *expected, size_t count) {
    assert_memory_equal(scene->state, expected, count * sizeof *expected);
}

static const double *parameter(const lg_scene *scene, const char *key) {
    const lg_parameter_entry *row =
        lg_system_parameters(lg_system_name(scene->system), lg_system_form(scene->system));
    const double *values = lg_system_parameter_values(scene->system);
    for (; strcmp(row->key, key) != 0; row++)
        values += row->count > 0 ? row->count : lg_system_links(scene->system);
    return values;
}

TEST("every key of a scene is read") {
    static const double state12[12] = {0.6, 0, 0.8, 0, 2, 0, 0, 1, 0, 1, 0, -3};
    lg_scene scene = read_text("scene.yaml", good_scene, NULL);
    assert_string_equal(lg_system_name(scene.system), "pendulum-chain");
    assert_string_equal(lg_system_form(scene.system), "hamiltonian");
    assert_true(lg_system_links(scene.system) == 2 && lg_system_dim(scene.system) == 12);
    assert_close(parameter(&scene, "gravity")[0], 9.81, 0, 0);
    assert_close(parameter(&scene, "masses")[1], 1.3, 0, 0);
    assert_close(parameter(&scene, "lengths")[1], 0.8, 0, 0);
    assert_state(&scene, state12, 12);
    assert_true(scene.has_initial && !scene.projected && scene.has_t_end && !scene.has_starts);
    assert_true(scene.t_end == 3 && scene.segments == 1);
    assert_true(scene.line_system == 2 && scene.line_form == 3 && scene.line_initial == 8);
    scene = read_text("scene.json", json_scene, NULL);
    assert_string_equal(lg_system_form(scene.system), "lagrangian");
    assert_close(parameter(&scene, "gravity")[0], -9.81, 0, 0);
    assert_close(parameter(&scene, "masses")[0], 1, 0, 0);
    assert_close(scene.state[4], 2, 0, 0);
    scene = read_text("flat.yaml",
                      "system: quartic\nform: hamiltonian\ninitial: {q: [1, -2], p: [.5, 4]}\n"
                      "starts: {kind: box, low: -3, high: 2, segments: 3}\n",
                      "hamiltonian");
    assert_int_equal(lg_system_dim(scene.system), 4);
    assert_true(scene.state[1] == -2 && scene.state[2] == 0.5);
    assert_true(scene.has_starts && scene.starts == LG_STARTS_BOX && scene.segments == 3);
    assert_true(scene.low == -3 && scene.high == 2 && !scene.has_t_end && scene.line_starts == 4);
    assert_true(scene.ahead == 0);
    scene =
        read_text("plane.yaml",
                  "system: pendulum-chain\ngravity: 1\nlinks: 2\nstarts: {kind: plane, ahead: 1.5}\n", NULL);
    assert_true(scene.starts == LG_STARTS_PLANE && scene.ahead == 1.5);
}

TEST("freed scenes and grids are zero and may be freed again") {
    lg_scene scene;
    lg_grid grid;
    assert_ok(lg_scene_read(NULL, file_of("scene.yaml", good_scene), NULL, &scene, NULL));
    assert_ok(lg_grid_read(NULL, file_of("grid.yaml", good_grid), &grid, NULL));
    for (int i = 0; i < 2; i++) {
        lg_scene_destroy(&scene);
        lg_grid_destroy(&grid);
        assert_true(scene.system == NULL && scene.state == NULL && grid.scene.system == NULL);
    }
    lg_scene_destroy(NULL);
    lg_grid_destroy(NULL);
}

TEST("one link and one number need no list; a scalar is a list of one") {
    static const struct {
        const char *text, *form;
        size_t links, count;
        double state[12];
    } cases[] = {
        {"system: pendulum-chain\ngravity: 1\nmasses: 2\ninitial: {q: [0, 0, 1], omega: [1, 0, 0]}\n",
         "lagrangian",
         1,
         6,
         {0, 0, 1, 1, 0, 0}},
        {"system: pendulum-chain\ngravity: 1\nmasses: [2]\ninitial: {q: [[0, 0, 1]], omega: [1, 0, 0]}\n",
         "lagrangian",
         1,
         6,
         {0, 0, 1, 1, 0, 0}},
        {"system: oscillator\ninitial: {q: 3, p: [4]}\n", NULL, 0, 2, {3, 4}},
        /* The number of links may follow from the start alone. */
        {"system: pendulum-chain\ngravity: 1\n"
         "initial: {q: [[0, 0, 1], [0, 1, 0]], omega: [[0, 0, 0], [0, 0, 2]]}\n",
         "lagrangian",
         2,
         12,
         {0, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 2}},
        /* Parts that are left out have their defaults. */
        {"system: heavy-top\ninitial: {pi: [1, 2, 3]}\n",
         "cotangent",
         0,
         12,
         {1, 0, 0, 0, 1, 0, 0, 0, 1, 1, 2, 3}}};
    for (size_t i = 0; i < LG_COUNT(cases); i++) {
        const lg_scene scene = read_text("short.yaml", cases[i].text, NULL);
        if (cases[i].form != NULL) assert_string_equal(lg_system_form(scene.system), cases[i].form);
        assert_int_equal(lg_system_links(scene.system), cases[i].links);
        if (i < 2) assert_close(parameter(&scene, "masses")[0], 2, 0, 0);
        assert_state(&scene, cases[i].state, cases[i].count);
    }
}

TEST("a scene may have many links") {
    enum { LINKS = 10000 };
    char *text = TEST_ARRAY(char, LINKS * 20 + 200), *at = text;
    at += sprintf(at, "system: pendulum-chain\ngravity: 1\ninitial:\n  q: [");
    for (int i = 0; i < LINKS; i++) at += sprintf(at, "[0,0,%d],", i == 7 ? -1 : 1);
    at += sprintf(at, "]\n  omega: [");
    for (int i = 0; i < LINKS; i++) at += sprintf(at, "[%d,0,0],", i);
    at += sprintf(at, "]\n");
    lg_scene scene = read_text("long.yaml", text, NULL);
    assert_int_equal(lg_system_links(scene.system), LINKS);
    assert_close(scene.state[6 * 7 + 2], -1, 0, 0);
    assert_close(scene.state[6 * (LINKS - 1) + 3], LINKS - 1, 0, 0);
}

/* ---- scenes of all systems, made from their tables ---- */

/* room for the numbers of a system's state and for its parameters; a system with more fails the test */
enum { MOST = 256 };

typedef struct whole {
    const char *name, *form;
    size_t links;
    const char *key, *value; /* text used instead of the value of this key ("initial.q"); NULL: no change */
    bool twice, gone;        /* the key is written twice, or left out */
    char text[8192];
    size_t used;
    unsigned line, key_line;
} whole;

static void put(whole *w, const char *format, ...) __attribute__((format(printf, 2, 3)));
static void put(whole *w, const char *format, ...) {
    va_list arguments;
    va_start(arguments, format);
    w->used += (size_t)vsnprintf(w->text + w->used, sizeof w->text - w->used, format, arguments);
    va_end(arguments);
    assert_true(w->used < sizeof w->text);
}

static void put_block(whole *w, const size_t shape[3], size_t level, const double **next) {
    if (level == 3) {
        put(w, "%.17g", *(*next)++);
        return;
    }
    const bool list = shape[level] > 1;
    if (list) put(w, "[");
    for (size_t i = 0; i < shape[level]; i++) {
        if (i > 0) put(w, ", ");
        put_block(w, shape, level + 1, next);
    }
    if (list) put(w, "]");
}

static void put_key(whole *w, const char *prefix, const char *key, const size_t shape[3],
                    const double *values) {
    const bool chosen = w->key != NULL && strcmp(test_text("%s%s", prefix, key), w->key) == 0;
    if (chosen && w->gone) return;
    for (int i = 0; i < (chosen && w->twice ? 2 : 1); i++) {
        const double *next = values;
        put(w, "%s%s: ", *prefix != '\0' ? "  " : "", key);
        w->line++;
        if (chosen && w->value != NULL)
            put(w, "%s", w->value);
        else
            put_block(w, shape, 0, &next);
        put(w, "\n");
        if (chosen) w->key_line = w->line;
    }
}

static double number(size_t i) {
    return 0.3 + 0.0625 * (double)i;
}

/* Makes a point of the space by a group element that rotates and shifts all copies. */
static void make_state(const lg_space *space, double *y) {
    double a[MOST];
    size_t at = 0;
    memset(y, 0, space->dim * sizeof *y);
    for (size_t f = 0; f < space->factors; f++) {
        const lg_space_kind kind = space->factor[f].kind;
        for (size_t i = 0; i < space->factor[f].count; i++, at += lg_space_kind_entry(kind)->state)
            for (size_t d = 0; d < 3 && kind != LG_SPACE_RN; d++)
                y[at + (kind == LG_SPACE_SO3 || kind == LG_SPACE_SE3 ? 4 * d : 0)] = 1;
    }
    assert_true(space->algebra_dim <= MOST);
    for (size_t i = 0; i < space->algebra_dim; i++) a[i] = number(i);
    lg_space_act(space, a, y, y);
}

static void gather(const lg_state_entry *row, size_t links, const double *y, double *out) {
    const size_t blocks = row->outer > 0 ? row->outer : links, size = row->rows * row->columns;
    for (size_t b = 0; b < blocks; b++)
        memcpy(out + b * size, y + row->first + b * row->stride, size * sizeof *y);
}

/* Writes a scene with all keys of the system and test values. parameters and y get the numbers that must be
 * read. */
static void compose(whole *w, double *parameters, double *y) {
    lg_system *system = NULL;
    lg_system_options options;
    lg_named_values named[MOST];
    size_t n = 0, used = 0;
    double part[MOST];
    w->used = w->line = w->key_line = 0;
    put(w, "system: %s\n", w->name);
    if (w->form != NULL) put(w, "form: %s\n", w->form);
    if (w->links > 0) put(w, "links: %zu\n", w->links);
    w->line = 1U + (w->form != NULL) + (w->links > 0);
    for (const lg_parameter_entry *row = lg_system_parameters(w->name, w->form); row->key != NULL;
         row++, n++) {
        const size_t count = row->count > 0 ? row->count : w->links;
        assert_true(n < MOST && used + count <= MOST);
        for (size_t i = 0; i < count; i++)
            parameters[used + i] = row->rule == LG_PARAMETER_UNIT_VECTOR ? (i == 1   ? 0.6
                                                                            : i == 2 ? 0.8
                                                                                     : 0)
                                                                         : number(used + i);
        named[n] = (lg_named_values){row->key, parameters + used, count};
        put_key(w, "", row->key, (const size_t[3]){1, 1, count}, parameters + used);
        used += count;
    }
    lg_system_options_init(&options);
    options.form = w->form;
    options.links = w->links > 0 ? w->links : 1;
    options.parameters = named;
    options.parameter_count = n;
    assert_ok(lg_system_create(NULL, w->name, &options, &system, NULL));
    assert_true(lg_system_dim(system) <= MOST);
    make_state(lg_system_space(system), y);
    lg_system_destroy(system);
    put(w, "initial:\n");
    w->line++;
    for (const lg_state_entry *row = lg_system_state(w->name, w->form); row->key != NULL; row++) {
        gather(row, w->links, y, part);
        put_key(w, "initial.", row->key,
                (const size_t[3]){row->outer > 0 ? row->outer : w->links, row->rows, row->columns}, part);
    }
}

/* Number of links for systems with any number of links; 0 for others. */
static size_t links_of(const char *name, const char *form) {
    for (const lg_state_entry *row = lg_system_state(name, form); row->key != NULL; row++)
        if (row->outer == 0) return 2;
    return 0;
}

TEST("scenes of every system are read") {
    whole w = {.key = NULL};
    double parameters[MOST], y[MOST], found[MOST], expected[MOST];
    for (size_t i = 0; lg_system_at(i, &w.name, &w.form); i++) {
        w.links = links_of(w.name, w.form);
        compose(&w, parameters, y);
        lg_scene scene = read_text("system.yaml", w.text, NULL);
        assert_string_equal(lg_system_name(scene.system), w.name);
        if (w.form != NULL) assert_string_equal(lg_system_form(scene.system), w.form);
        assert_int_equal(lg_system_links(scene.system), w.links);
        for (size_t p = 0; p < lg_system_parameter_count(scene.system); p++)
            assert_close(lg_system_parameter_values(scene.system)[p], parameters[p], 0, 0);
        for (const lg_state_entry *row = lg_system_state(w.name, w.form); row->key != NULL; row++) {
            const size_t size = (row->outer > 0 ? row->outer : w.links) * row->rows * row->columns;
            gather(row, w.links, scene.state, found);
            gather(row, w.links, y, expected);
            for (size_t j = 0; j < size; j++) assert_close(found[j], expected[j], 0, 0);
        }
        assert_false(scene.projected);
    }
}

/* The scene of `w` with `value` for the key must be refused, with the line of the key and `word`. */
static void refuse(whole *w, const char *key, const char *value, const char *word) {
    double parameters[MOST], y[MOST];
    w->key = key;
    w->value = value;
    compose(w, parameters, y);
    assert_refused(read_scene, file_of("system.yaml", w->text), LG_FORMAT,
                   test_text("line %u: ", w->key_line), word);
}

/* Values that are invalid for a number, a list or a shape of any system. */
static void refuse_values(whole *w, const char *key, bool positive) {
    static const char *const never[] = {"1.0abc", "0x",    "0x1p3", "nan",         ".nan",   "inf",
                                        "-.inf",  "1e999", "1,",    "[1, 2, nan]", "{a: 1}", "\"1\"",
                                        "true",   "",      "[]",    "[[]]"};
    static const char *const wrong[] = {"[1, 2, 3, 4, 5, 6, 7]", "[[1, 2], [3, 4], [5, 6], [7, 8]]",
                                        "[[[[1]]]]", "&a [*a, *a, *a]", "[[1, 2, 3], [4, 5]]"};
    static const char *const nonpositive[] = {"0", "-1", "[1, 0]", "[0, 1, 1]", "[1, 1, -2]", "1e301"};
    const char *name = strchr(key, '.') != NULL ? strchr(key, '.') + 1 : key;
    for (size_t i = 0; i < LG_COUNT(never); i++) refuse(w, key, never[i], name);
    for (size_t i = 0; i < LG_COUNT(wrong); i++) refuse(w, key, wrong[i], "");
    for (size_t i = 0; positive && i < LG_COUNT(nonpositive); i++) refuse(w, key, nonpositive[i], name);
}

static void refuse_twice(whole *w, const char *key) {
    w->twice = true;
    refuse(w, key, NULL, "twice");
    w->twice = false;
}

static void refuse_gone(whole *w, const char *key, bool needed) {
    double parameters[MOST], y[MOST];
    w->key = key;
    w->value = NULL;
    w->gone = true;
    compose(w, parameters, y);
    if (needed)
        assert_refused(read_scene, file_of("system.yaml", w->text), LG_FORMAT, "is missing", key);
    else
        assert_ok(read_scene(NULL, file_of("system.yaml", w->text), NULL, NULL));
    w->gone = false;
}

TEST("for every system, errors in its scene are refused") {
    whole w = {.key = NULL};
    for (size_t i = 0; lg_system_at(i, &w.name, &w.form); i++) {
        w.links = links_of(w.name, w.form);
        for (const lg_parameter_entry *row = lg_system_parameters(w.name, w.form); row->key != NULL; row++) {
            refuse_values(&w, row->key, row->rule == LG_PARAMETER_POSITIVE);
            refuse_twice(&w, row->key);
            refuse_gone(&w, row->key, row->fallback == NULL);
            if (row->rule == LG_PARAMETER_UNIT_VECTOR)
                refuse(&w, row->key, "[0, 0.6, 0.8001]", "unit vector");
        }
        for (const lg_state_entry *row = lg_system_state(w.name, w.form); row->key != NULL; row++) {
            const char *key = test_text("initial.%s", row->key);
            refuse_values(&w, key, false);
            refuse_twice(&w, key);
            const bool alone = lg_system_state(w.name, w.form)[1].key == NULL;
            if (!alone) refuse_gone(&w, key, row->fallback == NULL);
        }
    }
}

TEST("keys of other systems and forms and unknown keys are refused, and the valid keys are listed") {
    static const struct {
        const char *text, *line, *word;
    } cases[] = {
        {"system: rigid-body\ncolour: red\n", "line 2",
         "unknown key 'colour'; known: system, form, t_end, initial"},
        {"system: rigid-body\ninitial: {q: 1, nu: [1, 2, 3]}\n", "line 2", "initial.q"},
        {"system: rigid-body\ninitial: {nu: [1, 2, 3]}\n", "line 2", "unknown key 'initial.nu'; known: mu"},
        {"system: rigid-body\nmass: 1\n", "line 2", "'mass' does not belong to system rigid-body"},
        {"system: rigid-body\nlinks: 1\n", "line 2", "'links' does not belong"},
        {"system: rigid-body\nreference: parabola\n", "line 2", "'reference' does not belong"},
        {"system: rigid-body\ninertia: [1, 2, 3]\nform: free\n", "line 3", "one form only"},
        {"system: quadrotors\nreference: circle\n", "line 2", "'circle' is none of parabola"},
        {"system: quadrotors\nlinks: 2\n", "line 2", "'links' does not belong"},
        {"system: quadrotors\ninitial: {q: [[0, 0, 1], [0, 0, 1]], Omega: 0}\n", "line 2",
         "system quadrotors (exact-thrusts; or `form: attitudes`)"},
        {"system: heavy-top\nform: indirect\n", "line 2",
         "'indirect' is none of cotangent, direct, lie-poisson, quadratic"},
        {"system: heavy-top\nform: direct\ninitial: {Gamma: [0, 0, 1], Pi: [1, 2, 3]}\n", "line 3",
         "'initial.Gamma' does not belong to system heavy-top (direct; or `form: cotangent`; or `form: "
         "lie-poisson`"},
        {"system: oscillator\nform: lagrangian\n", "line 2", "hamiltonian"},
        {"system: oscillator\nmasses: [1]\n", "line 2", "does not belong"},
        {"system: pendulum-chain\ngravity: 1\nlinks: 1\nreference: parabola\n", "line 4", "does not belong"},
    };
    for (size_t i = 0; i < LG_COUNT(cases); i++)
        assert_refused(read_scene, file_of("foreign.yaml", cases[i].text), LG_FORMAT, cases[i].line,
                       cases[i].word);
}

/* ---- forms of scenes ---- */

static const char *form_read(const char *text, const char *wanted) {
    return lg_system_form(read_text("form.yaml", text, wanted).system);
}

TEST("the form of a scene follows from the given parts of the start, or from the caller") {
    static const char bare[] = "system: pendulum-chain\ngravity: 1\nlinks: 2\n";
    static const char with_p[] =
        "system: pendulum-chain\ngravity: 1\ninitial: {q: [0, 0, 1], p: [1, 0, 0]}\n";
    static const char top[] = "system: heavy-top\ninitial: {Gamma: [0, 0, 1], Pi: [1, 2, 3]}\n";
    static const char given[] = "system: pendulum-chain\ngravity: 1\nform: lagrangian\nlinks: 2\n";
    static const char *const cases[][3] = {
        {bare, NULL, "lagrangian"},           {bare, "hamiltonian", "hamiltonian"},
        {with_p, NULL, "hamiltonian"},        {with_p, "lagrangian", "lagrangian"},
        {top, NULL, "lie-poisson"},           {"system: heavy-top\n", "hamiltonian", "cotangent"},
        {given, "hamiltonian", "hamiltonian"}};
    for (size_t i = 0; i < LG_COUNT(cases); i++)
        assert_string_equal(form_read(cases[i][0], cases[i][1]), cases[i][2]);
    assert_null(form_read("system: quartic\n", "hamiltonian"));
    assert_refused(read_scene, file_of("grid.yaml", "scene: pendulum.yaml\nintegrators: [cf4]\n"), LG_FORMAT,
                   "grid.yaml", "lg-hamiltonian study");
}

TEST("the drawn start is the start of the first trajectory that is generated with the same seed") {
    lg_scene scene = read_text("drawn.yaml",
                               "system: pendulum-chain\nform: hamiltonian\ngravity: 1\nlinks: 2\n"
                               "starts: {kind: box, low: 1, high: 3}\n",
                               NULL);
    lg_trajectory_options options;
    lg_trajectory_options_init(&options);
    options.trajectories = 2, options.points = 2, options.seed = 5;
    options.starts = LG_STARTS_BOX, options.low = 1, options.high = 3;
    double t[2], y[2 * 2 * 12], energy[2];
    assert_ok(lg_system_generate(NULL, scene.system, &options, t, y, energy, NULL));
    assert_ok(lg_scene_draw_start(&scene, 5));
    assert_memory_equal(scene.state, y, 12 * sizeof *y);
    assert_status(lg_scene_draw_start(&scene, 5), LG_INVALID_ARGUMENT);
    free(scene.state); /* was allocated after the scene got its owner */
    scene = read_text("drawn.yaml", "system: heavy-top\n", NULL);
    scene.starts = LG_STARTS_PLANE;
    assert_status(lg_scene_draw_start(&scene, 5), LG_UNSUPPORTED);
    assert_null(scene.state);
}

TEST("omega and p give the same motion, and either is read in both forms") {
    static const char head[] =
        "system: pendulum-chain\ngravity: 9.81\nmasses: [1, 1.3, 0.7]\nlengths: [1, 0.8, 1.5]\n";
    static const char turn[] = "initial: {q: [[0.6, 0, 0.8], [0, 1, 0], [0.48, 0.6, 0.64]],\n"
                               "  omega: [[0, 2, 0], [1, 0, -3], [0.8, 0, -0.6]]}\n";
    char text[2048];
    (void)snprintf(text, sizeof text, "%s%s", head, turn);
    lg_scene lagrangian = read_text("omega.yaml", text, NULL),
             hamiltonian = read_text("omega.yaml", text, "hamiltonian");
    double work[512];
    assert_true(lg_system_work_size(lagrangian.system) / sizeof(double) <= LG_COUNT(work) &&
                lg_system_work_size(hamiltonian.system) / sizeof(double) <= LG_COUNT(work));
    assert_close(lg_system_hamiltonian(hamiltonian.system, hamiltonian.state, work),
                 lg_system_hamiltonian(lagrangian.system, lagrangian.state, work), 1e-14, 0);
    /* The last p is m_33 q_3' + P_3 (m_31 q_1' + m_32 q_2') with q' = omega x q. */
    const double *y = lagrangian.state;
    double rate[3][3], sum[3], along = 0;
    for (int i = 0; i < 3; i++) lg_cross3(y + 6 * i + 3, y + 6 * i, rate[i]);
    for (int c = 0; c < 3; c++) {
        sum[c] = 0.7 * 1.5 * (1 * rate[0][c] + 0.8 * rate[1][c]);
        along += y[12 + c] * sum[c];
    }
    for (int c = 0; c < 3; c++)
        assert_close(hamiltonian.state[15 + c], 0.7 * 1.5 * 1.5 * rate[2][c] + sum[c] - along * y[12 + c], 0,
                     1e-14);
    /* The conversion back. */
    int used = snprintf(text, sizeof text, "%sform: lagrangian\ninitial:\n", head);
    for (int part = 0; part < 2; part++) {
        used += snprintf(text + used, sizeof text - (size_t)used, "  %s:\n", part == 0 ? "q" : "p");
        for (int i = 0; i < 3; i++) {
            const double *x = hamiltonian.state + 6 * i + 3 * part;
            used += lg_format(text + used, sizeof text - (size_t)used, "    - [%.17g, %.17g, %.17g]\n", x[0],
                              x[1], x[2]);
        }
    }
    lg_scene back = read_text("p.yaml", text, NULL);
    assert_string_equal(lg_system_form(back.system), "lagrangian");
    for (int i = 0; i < 18; i++) assert_close(back.state[i], lagrangian.state[i], 0, 1e-14);
}

/* ---- starts near the manifold ---- */

static char logged[512];
static void keep_log(void *user, lg_log_level level, const char *message) {
    (void)user, (void)level;
    (void)snprintf(logged, sizeof logged, "%s", message);
}

TEST("a start that is off the manifold by rounding is projected, which is reported; more is an error") {
    lg_scene scene;
    lg_context_options options;
    lg_context *context;
    lg_context_options_init(&options);
    options.log = keep_log;
    assert_ok(lg_context_create(&options, &context));
    lg_test_owns(context, release_context);
    const char *path = changed("near.yaml", good_scene, "[0.6, 0, 0.8]", "[0.6000001, 0, 0.8000002]");
    assert_ok(lg_scene_read(context, path, NULL, &scene, NULL));
    const double *q = own_lg_scene(scene)->state;
    assert_true(scene.projected);
    assert_close(scene.projection, 2.2e-7, 0.01, 0);
    assert_close(q[0] * q[0] + q[1] * q[1] + q[2] * q[2], 1, 1e-15, 0);
    assert_close(q[0] / q[2], 0.6000001 / 0.8000002, 1e-15, 0);
    assert_non_null(strstr(logged, "near.yaml"));
    assert_non_null(strstr(logged, "line"));
    scene = read_form(changed("near.yaml", good_scene, "[1, 0, -3]", "[1, 1e-7, -3]"), NULL);
    assert_true(scene.projected && scene.state[10] == 0);
    assert_refused(read_scene, changed("off.yaml", good_scene, "[0, 1, 0]", "[0, 1.00001, 0]"), LG_FORMAT,
                   "line 9", "sphere");
    assert_refused(read_scene, changed("off.yaml", good_scene, "[0, 2, 0]", "[0.01, 2, 0]"), LG_FORMAT,
                   "line 10", "orthogonal");
}

typedef struct bad_text {
    const char *from, *to, *line, *word;
} bad_text;

/* Each change of `good` must be refused. */
static void refuse_changes(read_fn reader, const char *good, const bad_text *rows, size_t count) {
    for (size_t i = 0; i < count; i++)
        assert_refused(reader, changed("bad.yaml", good, rows[i].from, rows[i].to), LG_FORMAT, rows[i].line,
                       rows[i].word);
}

#define BODIES                                                                                               \
    "system: quadrotors\ninitial:\n  R: [[[0.6, -0.8, 0], [0.8, 0.6, 0], [0, 0, 1]],\n"                      \
    "    [[1, 0, 0], [0, 1, 0],\n [0, 0, 1]]]\n"                                                             \
    "  q: [[0.6, 0, 0.8],\n [-0.6, 0, 0.8]]\n  omega: [[0, 1, 0],\n [0, -1, 0]]\nform: attitudes\n"

/* Tests rotations and the links of the quadrotors. */
TEST("rotations are projected if nearly orthogonal and refused otherwise") {
    static const char *const tops[] = {
        "system: rigid-body-attitude\ninitial: {pi: [1, 2, 3], R: [[1, 0, 0],\n[0, 1, 0], [0, 0, %s]]}\n",
        "system: heavy-top\nform: cotangent\ninitial: {pi: [1, 2, 3], Q: [[1, 0, 0],\n[0, 1, 0], [0, 0, "
        "%s]]}\n",
        "system: heavy-top\nform: direct\ninitial: {pi: [1, 2, 3], Q: [[1, 0, 0],\n[0, 1, 0], [0, 0, %s]]}\n",
        "system: heavy-top\nform: quadratic\ninitial: {pi: [1, 2, 3], Q: [[1, 0, 0],\n[0, 1, 0], [0, 0, "
        "%s]]}\n"};
    for (size_t i = 0; i < LG_COUNT(tops); i++) {
        lg_scene scene = read_text("top.yaml", test_text(tops[i], "1.0000001"), NULL);
        assert_true(scene.projected);
        assert_close(scene.projection, 2e-7, 1e-3, 0);
        assert_close(scene.state[8], 1, 0, 1e-15);
        assert_close(lg_space_manifold_error(lg_system_space(scene.system), scene.state), 0, 0, 1e-15);
        assert_refused(read_scene, file_of("top.yaml", test_text(tops[i], "1.00001")), LG_FORMAT,
                       i == 0 ? "line 2" : "line 3", "not a rotation");
        assert_refused(read_scene, file_of("top.yaml", test_text(tops[i], "-1")), LG_FORMAT,
                       i == 0 ? "initial.R" : "initial.Q", "determinant is -1");
    }
    lg_scene scene = read_text("bodies.yaml", BODIES, NULL);
    assert_false(scene.projected);
    assert_close(scene.state[0], -2, 0, 0);
    assert_close(scene.state[18], 0.6, 0, 0);
    assert_close(scene.state[21], 0.8, 0, 0);
    static const bad_text rows[] = {{"[[0.6, -0.8, 0]", "[[0.6, 0.8, 0]", "line 3", "initial.R: matrix 1"},
                                    {"\n [0, 0, 1]]]", "\n [0, 0, 2]]]", "line 4", "initial.R: matrix 2"},
                                    {"[-0.6, 0, 0.8]", "[-0.6, 0, 0.7]", "line 7", "initial.q: row 2"},
                                    {"[0, -1, 0]", "[1, -1, 0]", "line 9", "initial.omega: row 2"}};
    refuse_changes(read_scene, BODIES, rows, LG_COUNT(rows));
}

/* Values that are invalid for every system are tested above, for every system. */
TEST("an invalid scene is refused with its line and a word") {
    static const bad_text cases[] = {
        {"gravity: 9.81", "gravity: 9,81", "line 4", "gravity"},
        {"system: pendulum-chain\n", "", "line 2", "'system' is missing"},
        {"system: pendulum-chain", "system: pendulum", "line 2", "pendulum-chain"},
        {"form: hamiltonian", "form: newtonian", "line 3", "form"},
        {"form: hamiltonian", "form: [hamiltonian]", "line 3", "form"},
        {"form: hamiltonian", "form:", "line 3", "form"},
        {"masses: [1, 1.3]", "masses: [1, 1.3, 2]", "line 6", "lengths"},
        {"masses: [1, 1.3]", "links: 2.5", "line 5", "whole"},
        {"masses: [1, 1.3]", "links: 0", "line 5", "outside [1, 1e+06]"},
        {"masses: [1, 1.3]", "links: 1000001", "line 5", "outside [1, 1e+06]"},
        {"masses: [1, 1.3]", "links: 1e300", "line 5", "links"},
        {"masses: [1, 1.3]", "links: 3", "line 6", "lengths"},
        {"masses: [1, 1.3]", "initial.q: [1, 1.3]", "line 5", "unknown key 'initial.q'; known: system,"},
        {"masses: [1, 1.3]", "[1, 2]: 3", "line 5", "key"},
        {"[0, 1, 0]]", "[0, 1]]", "line 9", "3 are expected"},
        {"[0, 1, 0]]", "[0, 1, 0], [0, 0, 1]]", "line 8", "initial.q"},
        {"[0, 1, 0]]", "[0, one, 0]]", "line 9", "'one'"},
        {"[0, 1, 0]]", "0]", "line 9", "initial.q"},
        {"  p: [[0, 2, 0], [1, 0, -3]]\n", "  p: [[0, 2, 0]]\n", "line 10", "initial.p"},
        {"  p: ", "  omega: [[0, 2, 0], [1, 0, -3]]\n  p: ", "line 8", "not both"},
        {"t_end: 3", "t_end: 0", "line 11", "t_end"},
        {"t_end: 3", "t_end: -1", "line 11", "t_end"},
        {"t_end: 3", "t_end: 3 s", "line 11", "t_end"},
        {"t_end: 3", "starts: {kind: ball}", "line 11", "starts.kind"},
        {"t_end: 3", "starts: {low: 1}", "line 11", "starts.kind"},
        {"t_end: 3", "starts: {kind: thesis, low: 1}", "line 11", "box"},
        {"t_end: 3", "starts: {kind: box, low: 2, high: 1}", "line 11", "low"},
        {"t_end: 3", "starts: thesis", "line 11", "starts"},
        {"t_end: 3", "starts: {kind: thesis, ahead: -1}", "line 11", "ahead"},
        {"t_end: 3", "starts: {kind: thesis, segments: 0}", "line 11", "segments"},
        {"t_end: 3", "t_end: 3\n---\nsystem: quartic", "line 13", "second document"},
        {"t_end: 3", "t_end: [3", "line", "YAML"},
        {"t_end: 3", "t_end: \x01", "line 11", "YAML"},
        {"t_end: 3", "t_end: *nowhere", "line 11", "aliases"},
        {"t_end: 3", "<<: {a: 1}", "line 11", "unknown key"},
        {"t_end: 3", "a: [[[[[[[[[[[[[[[[[[[[[[", "line 11", "nested too deep"},
        {"t_end: 3", "\"t\\0end\": 3", "line 11", "unknown key"},
    };
    refuse_changes(read_scene, good_scene, cases, LG_COUNT(cases));
    static const char *const texts[][3] = {
        {"system: quartic\ninitial: {q: [1], p: [1, 2]}\n", "line 2", "initial.q"},
        {"system: quartic\nform: lagrangian\n", "line 2", "hamiltonian"},
        {"system: pendulum-chain\ngravity: 1\n", "line 1", "links"},
        {"- system\n- quartic\n", "line 1", "keys"},
        {"# only a comment\n", "line 1", "no keys and values"},
        {"system: quartic\ninitial: &a {q: *a, p: [1, 2]}\n", "line 2", "aliases"}}; /* contains itself */
    for (size_t i = 0; i < LG_COUNT(texts); i++)
        assert_refused(read_scene, file_of("bad.yaml", texts[i][0]), LG_FORMAT, texts[i][1], texts[i][2]);
}

TEST("a damaged scene is refused") {
    refuse_damaged_files(read_scene, file_of("scene.json", json_scene), "line");
    survive_changed_bytes(read_scene, file_of("scene.json", json_scene), 300);
    survive_changed_bytes(read_scene, file_of("scene.yaml", good_scene), 300);
    /* A scene in block style that is cut may be a valid shorter scene. It must be read, or refused with a
     * line. */
    for (size_t tenth = 1; tenth < 10; tenth++) {
        lg_error error = {LG_OK, ""};
        const char *bad = scratch_path("cut.yaml");
        write_bytes_to(bad, good_scene, (sizeof good_scene - 1) * tenth / 10);
        lg_status status = read_scene(NULL, bad, NULL, &error);
        assert_true(status == LG_OK ||
                    (status == LG_FORMAT && strstr(error.message, "cut.yaml: line") != NULL));
    }
    /* A large file, nested so deeply that a slow parser would take very long. */
    size_t bytes = (1 << 20) + 1;
    char *big = TEST_ARRAY(char, bytes);
    memset(big, '[', bytes);
    write_bytes_to(scratch_path("big.yaml"), big, bytes);
    assert_refused(read_scene, scratch_path("big.yaml"), LG_FORMAT, "larger", "");
    write_bytes_to(scratch_path("big.yaml"), big, bytes - 1);
    assert_refused(read_scene, scratch_path("big.yaml"), LG_FORMAT, "line 1", "nested too deep");
    memset(big, '-', bytes);
    for (size_t i = 1; i < bytes; i += 2) big[i] = ' ';
    write_bytes_to(scratch_path("big.yaml"), big, 20000);
    assert_refused(read_scene, scratch_path("big.yaml"), LG_FORMAT, "line 1", "");
}

/* ---- grids ---- */

static uint64_t runs_of(const lg_grid *grid) {
    return (uint64_t)grid->integrator_count * grid->n.count * grid->m.count * grid->eps.count *
           grid->penalty.count * grid->substeps.count * grid->repeats;
}

TEST("every key of a grid is read") {
    (void)file_of("scene.yaml", good_scene);
    lg_grid grid = read_good_grid(file_of("grid.yaml", good_grid));
    assert_int_equal(runs_of(&grid), 2 * 2 * 1 * 3 * 2 * 2 * 5);
    assert_int_equal(lg_system_links(grid.scene.system), 2);
    assert_true(grid.integrators[0] == lg_scheme_find("cf4") && grid.integrators[1] == lg_scheme_find("rk4"));
    assert_true(grid.n.values[1] == 500 && grid.m.values[0] == 5 && grid.m.count == 1 &&
                grid.substeps.values[1] == 2);
    assert_true(grid.eps.values[2] == 0.1 && grid.penalty.values[1] == 1e-3 && grid.t_end == 0.1);
    const lg_mlp *net = &grid.run.model.net;
    const lg_fit_settings *how = &grid.run.training;
    assert_true(net->layers == 3 && net->width[2] == 30 && net->activation == LG_TANH);
    assert_true(how->dtype == LG_F32 && grid.run.model.potential == LG_POTENTIAL_MLP);
    assert_true(grid.test_trajectories == 7 && grid.test_points == 9 && grid.seed == UINT64_MAX);
    assert_true(how->epochs == 100 && how->batch == 80 && how->lr_step == 50 && how->shards == 0);
    assert_close(how->lr, 1e-2, 0, 0);
    assert_close(read_good_grid(changed("grid.yaml", good_grid, "t_end: 0.1\n", "")).t_end, 3, 0, 0);
    grid = read_good_grid(file_of("own.yaml", "system: quartic\nt_end: 0.3\nintegrators: stormer-verlet\n"
                                              "N: 900\nM: 6\nhidden: [100, 50, 50]\n"));
    assert_string_equal(lg_system_name(grid.scene.system), "quartic");
    assert_int_equal(runs_of(&grid), 1);
    assert_true(grid.t_end == 0.3 && grid.eps.values[0] == 0 && grid.noise_kind == LG_NOISE_NORMAL);
    grid = read_good_grid(changed("grid.yaml", good_grid, "repeats: 5", "noise_kind: uniform"));
    assert_int_equal(grid.noise_kind, LG_NOISE_UNIFORM);
}

TEST("keys of a grid may be named as options") {
    (void)file_of("scene.yaml", good_scene);
    lg_grid grid =
        read_good_grid(changed("grid.yaml", good_grid, "integrators: [cf4, rk4]", "schemes: [rk4, cf4]"));
    assert_true(grid.integrators[0] == lg_scheme_find("rk4") && grid.integrators[1] == lg_scheme_find("cf4"));
    static const char *const pairs[][2] = {{"optimizer: lbfgs", "method: lbfgs"},
                                           {"initial-states: estimated", "starts: estimated"},
                                           {"validation-fraction: 0.25", "validation: 0.25"}};
    for (size_t i = 0; i < LG_COUNT(pairs); i++) {
        lg_hamiltonian_run run[2];
        for (int k = 0; k < 2; k++)
            run[k] = read_good_grid(changed("grid.yaml", good_grid, "repeats: 5", pairs[i][k])).run;
        for (const lg_field *row = lg_hamiltonian_fields; row->name != NULL; row++) {
            char text[2][LG_FIELD_TEXT_SIZE];
            for (int k = 0; k < 2; k++) lg_field_show(row, &run[k], text[k], sizeof text[k]);
            assert_string_equal(text[0], text[1]);
        }
    }
    assert_refused(
        read_grid,
        changed("bad.yaml", good_grid, "integrators: [cf4, rk4]\n", "integrators: rk4\nschemes: cf4\n"),
        LG_FORMAT, "line 3", "twice");
}

TEST("files that a grid names are found from its folder, from the folder of the process, or by their path") {
    char here[1024], deep[241] = "";
    const char *scene = file_of("scene.yaml", good_scene);
    (void)file_of("grid.yaml", good_grid);
    assert_non_null(getcwd(here, sizeof here));
    assert_int_equal(chdir(scratch), 0);
    LG_STATUS_OF(read_grid(NULL, "grid.yaml", NULL, NULL), status);
    assert_int_equal(chdir(here), 0);
    assert_int_equal(status, LG_OK);
    assert_ok(read_grid(NULL, changed("whole.yaml", good_grid, "scene.yaml", scene), NULL, NULL));
    memset(deep, 'x', sizeof deep - 1);
    assert_refused(read_grid,
                   changed("deep.yaml", good_grid, "repeats: 5", test_text("penalty_integral: ./%s", deep)),
                   LG_FORMAT, "penalty_integral", "is too long");
}

TEST("an invalid grid is refused with its line and a word") {
    static const bad_text cases[] = {
        {"integrators: [cf4, rk4]", "integrators: [cf4, rk5]", "line 2", "rk5"},
        {"integrators: [cf4, rk4]\n", "", "line 1", "'integrators' is missing"},
        {"N: [50, 500]", "N: [50, 0]", "line 3", "N"},
        {"N: [50, 500]", "N: [50, 1.5]", "line 3", "whole"},
        {"N: [50, 500]", "N: []", "line 3", "N"},
        {"N: [50, 500]", "N: [1,2,3,4,5,6,7,8,9,10,11,12,13,14,15,16,17]", "line 3", "17"},
        {"M: 5", "M: 1", "line 4", "M"},
        {"M: 5", "M: 5\nM: 5", "line 5", "twice"},
        {"eps: [0, 1e-3, 0.1]", "eps: [0, -1]", "line 5", "eps"},
        {"eps: [0, 1e-3, 0.1]", "eps: [.nan]", "line 5", "eps"},
        {"hidden: [30, 30]", "hidden: [30, 0]", "line 9", "hidden"},
        {"dtype: f32", "dtype: f16", "line 10", "f64, f32"},
        {"test: {trajectories: 7, points: 9}", "test: {trajectories: 7, point: 9}", "line 11", "test.point"},
        {"test: {trajectories: 7, points: 9}", "test: 7", "line 11", "test"},
        {"seed: 18446744073709551615", "seed: -1", "line 12", "seed"},
        {"seed: 18446744073709551615", "seed: 18446744073709551616", "line 12", "seed"},
        {"scene: scene.yaml", "scene: [scene.yaml]", "line 1", "scene"},
        {"scene: scene.yaml\n", "", "line 1", "'scene' or 'system'"},
        {"scene: scene.yaml", "scene: scene.yaml\nsystem: quartic", "line 2", "unknown key 'system'"},
        {"repeats: 5", "repeat: 5", "line 8", "unknown key"},
        {"repeats: 5", "noise_kind: pink", "line 8", "normal"},
        {"t_end: 0.1", "t_end: 0", "line 13", "t_end"},
        {"t_end: 0.1", "lr: 0", "line 13", "lr"},
    };
    (void)file_of("scene.yaml", good_scene);
    refuse_changes(read_grid, good_grid, cases, LG_COUNT(cases));
    assert_refused(read_grid, changed("bad.yaml", good_grid, "scene: scene.yaml", "scene: nothing.yaml"),
                   LG_NOT_FOUND, "line 1", "nothing.yaml");
    /* An error in the scene is reported with the line of the scene and the line of the grid. */
    (void)changed("scene.yaml", good_scene, "gravity: 9.81", "gravity: heavy");
    assert_refused(read_grid, file_of("bad.yaml", good_grid), LG_FORMAT, "line 1", "line 4");
    assert_refused(read_grid, file_of("bad.yaml", "system: quartic\nintegrators: rk4\nN: 1\nM: 2\n"),
                   LG_FORMAT, "t_end", "line 1");
}

TEST("a damaged grid is refused") {
    static const char json[] =
        "{\"system\": \"coupled-oscillators\", \"t_end\": 0.1, \"integrators\": [\"stormer-verlet\"],\n"
        " \"N\": [900], \"M\": [2], \"eps\": [0.1, 0.2], \"penalty\": [0, 1],\n"
        " \"hidden\": [30, 30], \"penalty_form\": \"published\"}";
    refuse_damaged_files(read_grid, file_of("grid.json", json), "line");
    survive_changed_bytes(read_grid, file_of("grid.json", json), 300);
}

/* ---- the shipped scenes ---- */

static bool is_yaml(const char *name) {
    const size_t length = strlen(name);
    return length > 5 && strcmp(name + length - 5, ".yaml") == 0;
}

TEST("every file in scenes/ is a scene or a grid, and every system has a scene") {
    enum { MOST_SYSTEMS = 128 };
    const char *name, *form, *const folder_name = LG_TEST_DIR "/../scenes";
    bool systems[MOST_SYSTEMS] = {false};
    DIR *folder = opendir(folder_name);
    assert_non_null(folder);
    for (struct dirent *entry; (entry = readdir(folder)) != NULL;) {
        if (!is_yaml(entry->d_name) || strncmp(entry->d_name, "study-", 6) == 0) continue;
        const lg_scene scene = read_form(test_text("%s/%.200s", folder_name, entry->d_name), NULL);
        assert_true(scene.has_t_end && !scene.projected);
        for (size_t i = 0; lg_system_at(i, &name, &form); i++) {
            assert_true(i < MOST_SYSTEMS);
            if (strcmp(name, lg_system_name(scene.system)) == 0) systems[i] = true;
        }
    }
    (void)closedir(folder);
    for (size_t i = 0; lg_system_at(i, &name, &form); i++)
        if (!systems[i]) fail_msg("no scene of %s", name);
}

static const char *scene_path(const char *name) {
    static char path[512];
    (void)snprintf(path, sizeof path, "%s/../scenes/%s.yaml", LG_TEST_DIR, name);
    return path;
}

TEST("the files in scenes/ have their form and their start") {
    static const struct {
        const char *name, *form;
        size_t dim, at; /* at: index of a number of the start; dim 0: no start */
        double value;
    } scenes[] = {{"pendulum", "hamiltonian", 0, 0, 0},
                  {"double-pendulum", "hamiltonian", 0, 0, 0},
                  {"chain3", "hamiltonian", 0, 0, 0},
                  {"chain5", "hamiltonian", 0, 0, 0},
                  {"quartic", NULL, 0, 0, 0},
                  {"coupled-oscillators", NULL, 0, 0, 0},
                  {"oscillator", NULL, 2, 0, 1},
                  {"rigid-body", NULL, 3, 1, 2},
                  {"attitude", NULL, 12, 9, 0.6},
                  {"heavy-top", "cotangent", 12, 11, -0.234375 * 4.61538},
                  {"heavy-top-reduced", "lie-poisson", 6, 2, -9.81},
                  {"chain-2", "lagrangian", 12, 8, 0.70710678118654752},
                  {"chain-20", "lagrangian", 120, 118, 1},
                  {"quadrotors", "exact-thrusts", 18, 12, -0.98480775301220806}};
    for (size_t i = 0; i < LG_COUNT(scenes); i++) {
        const lg_scene scene =
            read_form(scene_path(scenes[i].name), scenes[i].dim == 0 ? "hamiltonian" : NULL);
        if (scenes[i].form != NULL) assert_string_equal(lg_system_form(scene.system), scenes[i].form);
        assert_int_equal(scene.has_initial, scenes[i].dim > 0);
        if (scenes[i].dim == 0) continue;
        assert_int_equal(lg_system_dim(scene.system), scenes[i].dim);
        assert_close(scene.state[scenes[i].at], scenes[i].value, 1e-15, 0);
    }
    const lg_grid thesis = read_good_grid(scene_path("study-thesis"));
    const lg_grid few = read_good_grid(scene_path("study-small"));
    assert_int_equal(runs_of(&thesis), 960);
    assert_int_equal(runs_of(&few), 96);
}

/* ---- memory ---- */

static lg_status scene_step(const lg_context *context, void *user, lg_error *error) {
    return read_scene(context, user, NULL, error);
}
static lg_status grid_step(const lg_context *context, void *user, lg_error *error) {
    return read_grid(context, user, NULL, error);
}

TEST("every allocation may fail, and nothing leaks") {
    const char *scene = file_of("scene.yaml", good_scene), *grid = file_of("grid.yaml", good_grid);
    assert_int_equal(fail_every_allocation(scene_step, (void *)scene), 9);
    assert_int_equal(fail_every_allocation(grid_step, (void *)grid), 13);
}
