/* Classifiers on spectra of windows longer than one segment, whose segments overlap: exported as C, against
 * the library.
 * ctest-labels: slow apps/lg-export src/anomaly */
#define LENGTH_OF_WINDOWS 300
#include "export_classifier.h"

enum { FIRST = 16 }; /* in `samples` */

static void draw_window(void *user, lg_rng *rng, double *x) {
    fitted *f = ((exported *)user)->model;
    classifier_window(rng, (uint32_t)lg_rng_below(rng, f->of->classes), f->window);
    for (size_t i = 0; i < INPUTS; i++) x[i] = f->window[i];
}

static void reference(void *user, const double *x, double *y, double *jacobian) {
    fitted *f = ((const exported *)user)->model;
    for (size_t i = 0; i < INPUTS; i++) f->window[i] = (float)x[i];
    assert_ok(lg_classifier_decisions(&f->classifier, f->window, y, jacobian, f->work));
}

/* Logistic regression and support vectors: a tree's jumps are a matter of rounding. */
static size_t sample_of(size_t i) {
    return FIRST + 3 * i;
}

static const char *name(size_t i) {
    return classifier_name(sample_of(i));
}

static export_way way(size_t i) {
    return classifier_way(sample_of(i));
}

static void *make(size_t i) {
    fitted *f = classifier_make(sample_of(i));
    assert_int_equal(f->of->kind, SPECTRUM);
    assert_int_equal(f->classifier.features.spectrum.segments, 4);
    return f;
}

static void more(exported *e) {
    assert_int_equal(e->lib.inputs, INPUTS);
}

static const export_kind spectra = {2, name, way, make, draw_window, reference, more};

TEST("decisions and Jacobians of long windows are the library's in double precision") {
    export_compare_all(&spectra, "f64");
}

TEST("decisions and Jacobians of long windows are the library's in single precision") {
    export_compare_all(&spectra, "f32");
}

TEST("their self-tests pass in every way") {
    export_build(&spectra, 0, "f32", export_check_ways);
}

TEST_GROUP(export_begin, export_end)
