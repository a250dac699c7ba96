/* One driver for the exported models of every kind: made, written as C, compiled, compared with the library,
 * built in every way. A test file has a row of export_kind for its examples. */
#ifndef LG_TEST_EXPORT_MODELS_H
#define LG_TEST_EXPORT_MODELS_H

#include "export_support.h"

/* A model in NAME.h5, and its C in the folder NAME-DTYPE as model `m`. */
typedef struct exported {
    const char *name;
    char folder[64];
    void *model; /* of the kind */
    export_library lib;
} exported;

typedef struct export_kind {
    size_t count;
    const char *(*name)(size_t index);
    export_way (*way)(size_t index);
    void *(*make)(size_t index); /* writes NAME.h5; the running test owns what it takes */
    export_draw draw;            /* the user of both is an exported */
    export_reference reference;
    void (*more)(exported *of); /* compares what this kind has beside value and gradient */
} export_kind;

static inline exported export_saved(const char *name, const char *dtype, int seed, void *model) {
    char line[256];
    exported e = {.name = name, .model = model};
    (void)snprintf(e.folder, sizeof e.folder, "%s-%s", name, dtype);
    (void)snprintf(line, sizeof line, "%s.h5 --out %s --name m --dtype %s --seed %d", name, e.folder, dtype,
                   seed);
    export_run(line);
    return e;
}

static inline void export_compile(exported *e, export_way way) {
    e->lib = export_open(e->folder, "m", export_has(way.compiler) ? way.compiler : "cc", way.flags);
    assert_true(e->lib.single == (strstr(e->folder, "-f32") != NULL));
}

/* An example: value and gradient at 1000 inputs, then what else there is. */
static inline void export_compare_one(const export_kind *kind, exported *e, export_way way) {
    char title[160];
    export_compile(e, way);
    (void)snprintf(title, sizeof title, "%s, %s %s", e->folder, way.compiler, way.flags);
    export_compare(&e->lib, title, 1000, kind->draw, kind->reference, e);
    kind->more(e);
    export_close(&e->lib);
}

static inline void export_compare_all(const export_kind *kind, const char *dtype) {
    for (size_t i = 0; i < kind->count; i++) {
        const size_t mark = lg_test_owned();
        exported e = export_saved(kind->name(i), dtype, 7, kind->make(i));
        export_compare_one(kind, &e, kind->way(i));
        lg_test_give_back(mark);
    }
}

/* Self-tests by all compilers, objects that need libm alone, the stated stack. */
static inline void export_build(const export_kind *kind, size_t index, const char *dtype,
                                void (*ways)(const char *folder, const char *name)) {
    const exported e = export_saved(kind->name(index), dtype, 7, kind->make(index));
    ways(e.folder, "m");
    export_check_objects(e.folder, "m");
    export_check_stack(e.folder);
}

/* All examples, the first two at every level of optimisation. */
static inline void export_build_all(const export_kind *kind) {
    for (size_t i = 0; i < kind->count; i++) {
        const size_t mark = lg_test_owned();
        export_build(kind, i, i % 2 == 0 ? "f64" : "f32", i < 2 ? export_check_all_ways : export_check_ways);
        lg_test_give_back(mark);
    }
}

/* FOLDER/FILE says each of the words, which are separated by |. */
static inline void export_expect_words(const char *file, const char *words) {
    static char text[CLI_TEXT], list[2048];
    char *save = NULL;
    assert_true(cli_read(file, text, sizeof text) > 0);
    (void)snprintf(list, sizeof list, "%s", words);
    for (char *word = strtok_r(list, "|", &save); word != NULL; word = strtok_r(NULL, "|", &save))
        if (strstr(text, word) == NULL) fail_msg("%s does not say '%s'", file, word);
}

/* NAME_classify: the class; `score` (NULL: not asked for) gets one number a class. */
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
