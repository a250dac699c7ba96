/* Tests exported models of every kind in one way: make the model, export it as C, compile the C, compare it
 * with the library, and build it with many compilers and options. A suite supplies a table, whose rows begin
 * with an export_row, and one export_kind. */
#ifndef LG_TEST_EXPORT_MODELS_H
#define LG_TEST_EXPORT_MODELS_H

#include "export_support.h"

#include <float.h>

#include "liegrad/fit.h"
#include "liegrad/model.h"
#include "support/seed.h"

/* The model NAME.h5, the compiler and flags for its comparison, and the --scheme of its step (NULL or "": the
 * model's own scheme). */
typedef struct export_row {
    const char *name, *compiler, *flags, *scheme;
} export_row;

/* NAME.h5 loaded by the library, and its C in the folder NAME-DTYPE as model `m`. */
typedef struct exported {
    const export_row *row;
    char folder[64];
    void *of;           /* from export_kind.make, where it returns something; otherwise NULL */
    lg_model_file file; /* the model file; unused where `of` stands for a model */
    const lg_model *model;
    void *work;
    export_library lib;
} exported;

typedef struct export_kind {
    const void *rows;
    size_t size, count;
    /* Writes NAME.h5. Returns an object of the running test that stands for the model, or NULL if the
     * model is loaded from NAME.h5. */
    void *(*make)(const void *row);
    export_draw draw;           /* draws inputs; `user` of draw and reference is an `exported` */
    export_reference reference; /* the expected results; NULL: those of lg_model_jacobian */
    void (*more)(exported *e);  /* compares functions other than value and gradient; may be NULL */
} export_kind;
#define EXPORT_KIND(table, ...)                                                                              \
    { table, sizeof(table)[0], LG_COUNT(table), __VA_ARGS__ }

/* Some training settings: a model file must have them, and exported headers print them. */
static inline lg_fit_settings export_training(void) {
    return (lg_fit_settings){.dtype = LG_F64,
                             .epochs = 300,
                             .batch = 10,
                             .lr = 1e-3,
                             .lr_step = 1,
                             .lr_gamma = 0.5,
                             .adam_eps = 1e-8,
                             .shards = 4,
                             .seed = 1};
}

static inline const char *export_path(const char *name) {
    static char path[1024];
    (void)snprintf(path, sizeof path, "%s/%s.h5", cli_folder, name);
    return path;
}

static inline const void *export_row_at(const export_kind *kind, size_t i) {
    return (const char *)kind->rows + i * kind->size;
}

static inline const void *export_find(const export_kind *kind, const char *name) {
    for (size_t i = 0; i < kind->count; i++)
        if (strcmp(((const export_row *)export_row_at(kind, i))->name, name) == 0)
            return export_row_at(kind, i);
    fail_msg("no row %s", name);
    return NULL;
}

static inline void export_release(void *of) {
    exported *e = of;
    if (e->lib.handle != NULL) export_close(&e->lib);
    lg_model_file_destroy(&e->file);
}

/* Exports NAME.h5, which exists already, as C. */
static inline exported *export_saved(const export_row *row, const char *dtype, const char *options) {
    const bool scheme = row->scheme != NULL && row->scheme[0] != '\0';
    exported *e = TEST_ARRAY(exported, 1);
    e->row = row;
    lg_test_owns(e, export_release);
    (void)snprintf(e->folder, sizeof e->folder, "%s-%s", row->name, dtype);
    export_run(test_text("%s.h5 --out %s --name m --dtype %s --seed 7%s%s %s", row->name, e->folder, dtype,
                         scheme ? " --scheme " : "", scheme ? row->scheme : "", options));
    return e;
}

static inline void export_load(exported *e) {
    assert_told(lg_model_load(NULL, export_path(e->row->name), NULL, &e->file, &told));
    e->model = e->file.model;
    e->work = lg_test_memory(lg_model_work_size(e->model));
}

static inline exported *export_made(const export_kind *kind, const void *row, const char *dtype,
                                    const char *options) {
    void *of = kind->make(row);
    exported *e = export_saved(row, dtype, options);
    e->of = of;
    if (of == NULL) export_load(e);
    return e;
}

static inline void export_compile(exported *e, const char *compiler, const char *flags) {
    e->lib = export_open(e->folder, "m", export_has(compiler) ? compiler : "cc", flags);
    assert_true(e->lib.single == (strstr(e->folder, "-f32") != NULL));
    if (e->model == NULL) return;
    assert_int_equal(e->lib.inputs, lg_model_inputs(e->model));
    assert_int_equal(e->lib.outputs, lg_model_outputs(e->model));
}

static inline void export_jacobian(void *user, const double *x, double *y, double *jacobian) {
    const exported *e = user;
    lg_model_jacobian(e->model, x, y, jacobian, e->work);
}

/* Makes the row's model, exports it, and loads its C as a shared library. For further comparisons. */
static inline exported *export_opened(const export_kind *kind, const void *row, const char *dtype,
                                      const char *options) {
    exported *e = export_made(kind, row, dtype, options);
    export_compile(e, e->row->compiler, e->row->flags);
    return e;
}

/* Compares value and gradient at `inputs` random inputs, then calls kind->more. */
static inline void export_compare_one(const export_kind *kind, exported *e, size_t inputs) {
    export_compare(&e->lib, test_text("%s, %s %s", e->folder, e->row->compiler, e->row->flags), inputs,
                   kind->draw, kind->reference != NULL ? kind->reference : export_jacobian, e);
    if (kind->more != NULL) kind->more(e);
}

/* Every other row in this type; the others have their turn at other commits. */
static inline void export_compare_all(const export_kind *kind, const char *dtype) {
    const uint64_t first = commit_seed() + (strcmp(dtype, "f32") == 0);
    for (size_t i = first % 2; i < kind->count; i += 2) {
        const size_t mark = lg_test_owned();
        export_compare_one(kind, export_opened(kind, export_row_at(kind, i), dtype, ""), 1000);
        lg_test_give_back(mark);
    }
}

/* Runs the self-test compiled by all compilers, and checks that the objects need only libm and that the stack
 * is as stated. */
static inline void export_build(const export_kind *kind, const void *row, const char *dtype,
                                void (*ways)(const char *folder, const char *name)) {
    const size_t mark = lg_test_owned();
    const exported *e = export_made(kind, row, dtype, "");
    ways(e->folder, "m");
    export_check_objects(e->folder, "m");
    export_check_stack(e->folder);
    lg_test_give_back(mark);
}

/* Builds all rows; the first two at every optimisation level. */
static inline void export_build_all(const export_kind *kind) {
    for (size_t i = 0; i < kind->count; i++)
        export_build(kind, export_row_at(kind, i), i % 2 == 0 ? "f64" : "f32",
                     i < 2 ? export_check_all_ways : export_check_ways);
}

/* `file` must contain each of `words`, which are separated by |. A word that begins with ! must not occur. */
static inline void export_expect_words(const char *file, const char *words) {
    static char text[CLI_TEXT], list[2048];
    char *save = NULL;
    assert_true(cli_read(file, text, sizeof text) > 0);
    (void)snprintf(list, sizeof list, "%s", words);
    for (char *word = strtok_r(list, "|", &save); word != NULL; word = strtok_r(NULL, "|", &save)) {
        const bool absent = *word == '!';
        if ((strstr(text, word + absent) == NULL) != absent)
            fail_msg("%s %s '%s'", file, absent ? "says" : "does not say", word + absent);
    }
}

/* NAME_classify: returns the class. `score` gets one number per class; it may be NULL. */
static inline int export_classify(const export_library *lib, const double *x, double *score,
                                  uint32_t classes) {
    void *in = export_reals(lib, x, lib->inputs), *out = export_reals(lib, score, classes);
    EXPORT_FUNCTION(lib, "classify", int, (const void *, void *, void *), classify);
    export_spoil(lib);
    const int class = classify(in, out, lib->work);
    export_doubles(lib, out, score, classes);
    free(out);
    free(in);
    return class;
}

#endif
