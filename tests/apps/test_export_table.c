/* Table networks exported as C against the library: value, Jacobian, class.
 * ctest-labels: slow apps/lg-export src/table */
#include "export_models.h"

#include "liegrad/io.h"
#include "liegrad/metrics.h"
#include "liegrad/model.h"

typedef struct example {
    const char *name, *compiler, *flags;
    uint32_t inputs, outputs;
    double size; /* of the columns */
    lg_table_options options;
} example;

#define NETWORK(task_, kind, activation_, layers, width, linear_)                                            \
    {                                                                                                        \
        .task = LG_TABLE_##task_, .network = LG_NET_##kind, .activation = LG_##activation_,                  \
        .hidden_count = layers, .hidden = {width, width, width}, .linear = linear_                           \
    }

static const example examples[] = {
    {"plain", "gcc", "-O2", 4, 2, 1, NETWORK(REGRESSION, MLP, TANH, 2, 9, true)},
    {"large", "clang", "-O3", 3, 1, 1e9, NETWORK(REGRESSION, RESNET, SWISH, 2, 8, true)},
    {"small", "gcc", "-O1", 2, 5, 1e-9, NETWORK(REGRESSION, MULT, SIGMOID, 3, 6, false)},
    {"gates", "g++", "-O2", 1, 1, 1, NETWORK(REGRESSION, MULT_AFFINE, SINE, 2, 5, true)},
    {"classes", "gcc", "-O3 -march=native -ffp-contract=fast", 5, 4, 100,
     NETWORK(CLASSIFICATION, MLP, TANH, 1, 10, true)},
    {"two", "clang", "-O1", 3, 2, 1, NETWORK(CLASSIFICATION, RESNET, SWISH, 1, 7, false)},
};

typedef struct table {
    const example *of;
    lg_model_file file;
    void *work;
} table;

static void release(void *of) {
    lg_model_file_destroy(&((table *)of)->file);
}

static lg_scaler scaler_of(uint32_t columns, double size, lg_rng *rng) {
    lg_scaler made = {
        .channels = columns, .mean = TEST_ARRAY(double, columns), .scale = TEST_ARRAY(double, columns)};
    for (uint32_t c = 0; c < columns; c++) {
        made.mean[c] = 20 * size * lg_rng_normal(rng);
        made.scale[c] = size * lg_rng_uniform_in(rng, 0.5, 2);
    }
    return made;
}

static void *make(size_t i) {
    const example *e = &examples[i];
    char path[1024];
    lg_rng rng;
    lg_rng_seed(&rng, 13, i);
    lg_table_file file = {.run = {.training = {.dtype = LG_F64,
                                               .epochs = 9,
                                               .batch = 1,
                                               .lr = 1,
                                               .lr_step = 1,
                                               .lr_gamma = 0.5,
                                               .adam_eps = 1e-8,
                                               .shards = 1},
                                  .rows = 321},
                          .rmse = 0.125,
                          .accuracy = NAN,
                          .f1 = NAN};
    assert_ok(lg_table_init(&file.run.model, &e->options, e->inputs, e->outputs, NULL));
    file.parameters = lg_table_parameters(&file.run.model);
    file.theta = TEST_ARRAY(double, file.parameters);
    lg_table_initialise(&file.run.model, &rng, file.theta);
    for (size_t k = 0; k < file.parameters; k++) file.theta[k] += 0.2 * lg_rng_normal(&rng);
    file.inputs = scaler_of(e->inputs, e->size, &rng);
    if (e->options.task == LG_TABLE_REGRESSION) file.outputs = scaler_of(e->outputs, e->size, &rng);
    file.input_name = (char(*)[LG_TABLE_NAME])lg_test_memory(e->inputs * (size_t)LG_TABLE_NAME);
    for (uint32_t c = 0; c < e->inputs; c++) (void)snprintf(file.input_name[c], LG_TABLE_NAME, "in */ %u", c);
    (void)snprintf(file.run.data_sha256, sizeof file.run.data_sha256, "%064d", 42);
    (void)snprintf(file.provenance.command, sizeof file.provenance.command, "lg-fit train soil.csv");
    (void)snprintf(path, sizeof path, "%s/%s.h5", cli_folder, e->name);
    assert_ok(lg_model_save_table(NULL, path, &file, NULL, NULL));
    table *t = TEST_ARRAY(table, 1);
    t->of = e;
    assert_ok(lg_model_load(NULL, path, NULL, &t->file, NULL));
    lg_test_owns(t, release);
    t->work = TEST_ARRAY(unsigned char, lg_model_work_size(t->file.model));
    return t;
}

static const char *name_of(size_t i) {
    return examples[i].name;
}

static export_way way_of(size_t i) {
    return (export_way){examples[i].compiler, examples[i].flags};
}

static void draw(void *user, lg_rng *rng, double *x) {
    const table *t = ((const exported *)user)->model;
    const lg_scaler *in = &((const lg_table_file *)lg_model_file_of(&t->file, &lg_recipe_table))->inputs;
    for (uint32_t c = 0; c < in->channels; c++) x[c] = in->mean[c] + in->scale[c] * lg_rng_normal(rng);
}

static void reference(void *user, const double *x, double *y, double *jacobian) {
    const table *t = ((const exported *)user)->model;
    lg_model_jacobian(t->file.model, x, y, jacobian, t->work);
}

/* NAME_classify, where its class is not a matter of rounding. */
static void classify(exported *e) {
    const table *t = e->model;
    const uint32_t classes = t->of->outputs;
    double x[8], y[8], score[8];
    lg_rng rng;
    lg_rng_seed(&rng, 14, 15);
    for (int i = 0; i < 200 && t->of->options.task == LG_TABLE_CLASSIFICATION; i++) {
        double sum = 0;
        draw(e, &rng, x);
        for (uint32_t c = 0; c < t->of->inputs; c++) x[c] = export_rounded(&e->lib, x[c]);
        lg_model_eval(t->file.model, x, y, t->work);
        for (uint32_t c = 0; c < classes; c++) sum += exp(y[c]);
        const int found = export_classify(&e->lib, x, score, classes);
        for (uint32_t c = 0; c < classes; c++)
            assert_close(score[c], exp(y[c]) / sum, 0, 10 * e->lib.tolerance);
        if (fabs(y[lg_class_of(y, classes)] - y[found]) > 1e-4) fail_msg("class %d", found);
        assert_int_equal(export_classify(&e->lib, x, NULL, classes), found);
        x[0] = NAN;
        assert_int_equal(export_classify(&e->lib, x, score, classes), -1);
    }
}

static const export_kind tables = {LG_COUNT(examples), name_of, way_of, make, draw, reference, classify};

TEST("values, Jacobians and classes are the library's in double precision") {
    export_compare_all(&tables, "f64");
}

TEST("values, Jacobians and classes are the library's in single precision") {
    export_compare_all(&tables, "f32");
}

TEST("the header tells what a model is and what its columns are") {
    (void)make(0);
    (void)make(4);
    export_saved("plain", "f64", 1, NULL);
    export_expect_words("plain-f64/m.h",
                        "regression|inputs x (4)|in |outputs y (2)|0.125 of the outputs|lg-fit train "
                        "soil.csv|321 rows|0000000042|2 hidden layers of 9");
    export_saved("classes", "f64", 1, NULL);
    export_expect_words("classes-f64/m.h", "classification|CLASSES 4|class2|a logit a class");
    export_expect("! grep -r NAME */m.h");
}

TEST("a model of each task is built in every way") {
    export_build(&tables, 1, "f32", export_check_ways);
    export_build(&tables, 4, "f64", export_check_ways);
}

TEST_GROUP(export_begin, export_end)
