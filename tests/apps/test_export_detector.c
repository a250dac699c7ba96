/* Detectors exported as C against the library: value, gradient, probabilities and classes of random windows
 * in both types; what is written beside them.
 * ctest-labels: slow apps/lg-export src/anomaly src/nn */
#include "export_detector.h"

enum { ROWS = 1000, MOST_CLASSES = 8 };

/* ---- NAME_classify ---- */

/* Probabilities in the type, with the library's class where they are not close. */
static void check_classes(const exported *e) {
    const detector *d = e->model;
    const uint32_t classes = detector_of(d)->run.model.classes;
    double *x = TEST_ARRAY(double, e->lib.inputs), got[MOST_CLASSES], want[MOST_CLASSES], worst = 0;
    size_t seen[MOST_CLASSES] = {0};
    lg_rng rng;
    lg_rng_seed(&rng, 3, 4);
    for (size_t r = 0; r < ROWS; r++) {
        detector_draw((void *)(uintptr_t)e, &rng, x);
        for (size_t i = 0; i < e->lib.inputs; i++) d->window[i] = (float)x[i];
        lg_detector_eval(d->scores, d->window, want, NULL, d->work);
        const uint32_t class = lg_class_of(want, classes);
        double second = 0;
        for (uint32_t k = 0; k < classes; k++)
            if (k != class && want[k] > second) second = want[k];
        const int found = export_classify(&e->lib, x, got, classes);
        const double error = export_norm(got, want, classes);
        assert_true(error <= e->lib.tolerance * 4);
        worst = fmax(worst, error);
        assert_true(found >= 0 && found < (int)classes);
        assert_int_equal(export_classify(&e->lib, x, NULL, classes), found);
        if (want[class] - second > 10 * e->lib.tolerance) assert_int_equal(found, class);
        seen[found]++;
    }
    print_message("  probabilities %.2e; classes", worst);
    for (uint32_t k = 0; k < classes; k++) print_message(" %zu", seen[k]);
    print_message("\n");
    const char *const *names = export_symbol(&e->lib, "class_names");
    for (uint32_t k = 0; k < classes; k++) assert_string_equal(names[k], detector_of(d)->class_name[k]);
}

/* NAME_EVAL_WORK_SIZE numbers are enough for value and class. */
static void check_small_work(const exported *e) {
    const size_t size = (size_t)export_constant(e->folder, "m", "EVAL_WORK_SIZE");
    const size_t bytes = e->lib.single ? sizeof(float) : sizeof(double);
    void *in = lg_test_memory(e->lib.inputs * sizeof(double)),
         *out = lg_test_memory(MOST_CLASSES * sizeof(double));
    unsigned char *work = e->lib.work;
    assert_true(size > 0 && size <= e->lib.work_size);
    EXPORT_FUNCTION(&e->lib, "eval", void, (const void *, void *, void *), eval);
    EXPORT_FUNCTION(&e->lib, "classify", int, (const void *, void *, void *), classify);
    memset(work, 0x5a, e->lib.work_size * bytes);
    eval(in, out, work);
    (void)classify(in, out, work);
    for (size_t i = size * bytes; i < e->lib.work_size * bytes; i++) assert_int_equal(work[i], 0x5a);
}

static void more(exported *e) {
    const detector *d = e->model;
    assert_int_equal(e->lib.inputs, lg_model_inputs(d->file.model));
    assert_int_equal(e->lib.outputs, lg_model_outputs(d->file.model));
    check_classes(e);
    check_small_work(e);
}

static const export_kind detectors = {LG_COUNT(samples), detector_name,      detector_way, detector_make,
                                      detector_draw,     detector_reference, more};

TEST("values, gradients and classes are the library's in double precision") {
    export_compare_all(&detectors, "f64");
}

TEST("values, gradients and classes are the library's in single precision") {
    export_compare_all(&detectors, "f32");
}

/* Offsets of 10 at scales from 0.01 on: the rounding of the mean to float is given beside it. The depth is
 * 6. */
TEST("the header tells the windows, the classes and where they come from") {
    (void)export_saved(detector_name(0), "f32", 7, detector_make(0));
    export_expect_words("average-f32/m.h",
                        "#define m_CHANNELS 3|#define m_LENGTH 40|#define m_CLASSES 2|#define m_RATE 12.5|"
                        "x[channel * 40 + sample]|logit|0.9375|aaaaaaaa|channel 2|units|scaling|m_classify");
    export_expect_words("average-f32/m_weights.c", "/* theta from 0 on */|/* mean */|/* inverse_scale */");
    assert_close(export_constant("average-f32", "m", "DEPTH"), 6, 0, 0);
}

TEST("a detector is built in every way, one of default size with the flags of the Makefile") {
    export_build(&detectors, 3, "f32", export_check_ways);
    const sample of = detector_default("default", 4, 64, 3, false);
    detector_save(&of, 0, 0);
    const exported e = export_saved("default", "f64", 7, NULL);
    export_expect("make -C default-f64 test stack");
    export_check_objects(e.folder, "m");
    export_check_stack(e.folder);
}

/* The mean of a single logit over windows like those of the training data. */
static double mean_logit(const sample *of) {
    enum { DRAWN = 200 };
    detector_save(of, 0, 0);
    const detector *d = detector_load(of->name);
    const lg_scaler *scaler = &detector_of(d)->scaler;
    const size_t n = lg_model_inputs(d->file.model);
    double mean = 0, y;
    lg_rng rng;
    lg_rng_seed(&rng, 1, 1);
    for (int v = 0; v < DRAWN; v++) {
        for (size_t i = 0; i < n; i++)
            d->near[2][i] =
                scaler->mean[i / of->net.length] + scaler->scale[i / of->net.length] * lg_rng_normal(&rng);
        lg_model_eval(d->file.model, d->near[2], &y, d->work);
        mean += y / DRAWN;
    }
    return mean;
}

TEST("the tolerance tells of a logit that is a small difference of large terms, and self-tests of any seed "
     "pass") {
    sample of = detector_default("small", 2, 64, 2, false);
    of.net.activation = LG_SIGMOID;
    detector_save(&of, 0, -mean_logit(&of));
    for (int seed = 0; seed < 12; seed++) {
        char command[128];
        const exported e = export_saved("small", seed % 2 == 0 ? "f64" : "f32", seed, NULL);
        (void)snprintf(command, sizeof command, "make -C %s test CFLAGS=-O1", e.folder);
        export_expect(command);
        const double eps = seed % 2 == 0 ? DBL_EPSILON : (double)FLT_EPSILON;
        const double usual = 20 * eps * export_constant(e.folder, "m", "DEPTH");
        const double factor = export_constant(e.folder, "m", "TOLERANCE") / usual;
        if (!(factor > 5 && factor < 500)) fail_msg("factor %g", factor);
    }
    export_expect_words("small-f32/m.h", "contains the factor");
}

TEST("finite values whose norm is not are refused: the self-test could not tell an error") {
    static cli result;
    const sample of = detector_default("huge", 2, 64, 2, false);
    detector_save(&of, 1e200, 0);
    cli_expect("lg-export", "huge.h5 --out huge", 3, "huge.h5: gives numbers", &result);
    cli_expect("lg-export", "huge.h5 --out huge --dtype f32", 3, "huge.h5: holds numbers", &result);
    assert_false(cli_exists("huge"));
}

TEST_GROUP(export_begin, export_end)
