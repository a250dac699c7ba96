/* Rows about training that the field tables of all kinds of models have in common. */
#ifndef LG_SETTINGS_TRAINING_H
#define LG_SETTINGS_TRAINING_H

#include "liegrad/settings.h"

/* The options of training of every kind of model. `losses_` is squares, for a loss that is a sum of squares,
 * or any_loss, which leaves out --prior and the methods for squares. CHOICE(text) states the defaults of
 * method, epochs and prior, VALUE(text) the other defaults. */
#define TRAINING(run_, member, type, ...) LG_FIELD(run_, "run", #member, type, training.member, __VA_ARGS__)
#define TRAINING_ROWS(run_, method_, losses_, samples, methods_, VALUE, CHOICE)                              \
    LG_FIELD(run_, "run", method_, PHRASE, training.plan, .option = "optimizer", .usual = true,              \
             .parse = lg_plan_parse_##losses_, .phrase = lg_plan_show, .value_name = METHODS_FOR_##losses_,  \
             .form = "phases as in adam:100,ssbroyden", .optional = true, .methods = methods_,               \
             CHOICE("adam"), .unit = "M",                                                                    \
             .meaning = "Method of training; an epoch of adam and sgd is a step per batch, an epoch of "     \
                        "the others one evaluation of the loss on all data"),                                \
        TRAINING(run_, dtype, NAME, LG_NAMES([LG_F64] = "f64", [LG_F32] = "f32"), .methods = methods_,       \
                 VALUE("f64"), .meaning = "Type of the weights in training"),                                \
        TRAINING(run_, epochs, U64, .usual = true, .low = 1, .high = 1e9, .methods = methods_,               \
                 CHOICE("100"), .unit = "E",                                                                 \
                 .meaning = "Planned total number of epochs, including the epochs before a resume"),         \
        TRAINING(run_, batch, U64, .adam = true, .low = 1, .high = 1e9, .methods = methods_, VALUE("80"),    \
                 .unit = "B", .meaning = samples " in a batch"),                                             \
        TRAINING(run_, lr, REAL, .adam = true, .high = 1e3, .above = true, .methods = methods_,              \
                 VALUE("1e-2"), .unit = "R", .meaning = "Learning rate of Adam"),                            \
        TRAINING(run_, schedule, NAME, .adam = true, LG_NAMED(lg_schedule_name, LG_SCHEDULE_COUNT),          \
                 .optional = true, .methods = methods_, VALUE("step"),                                       \
                 .meaning = "Schedule of the learning rate"),                                                \
        TRAINING(run_, lr_step, U64, .adam = true, .low = 1, .high = 1e9, .methods = methods_, VALUE("50"),  \
                 .unit = "E",                                                                                \
                 .meaning =                                                                                  \
                     "Schedule step: number of epochs after which the rate is multiplied by --lr-gamma"),    \
        TRAINING(                                                                                            \
            run_, lr_gamma, REAL, .adam = true, .high = 1, .methods = methods_, VALUE("0.1"), .unit = "G",   \
            .meaning =                                                                                       \
                "Schedule step: this factor, above 0; schedule cosine: the factor of the rate at the end"),  \
        TRAINING(run_, weight_decay, REAL, .high = 1e3, .methods = methods_, VALUE("0"), .unit = "W",        \
                 .meaning = "L2 penalty in the gradient"),                                                   \
        TRAINING(run_, prior, REAL, .high = 1e6, .option = PRIOR_FOR_##losses_, .optional = true,            \
                 .methods = methods_, CHOICE("0"), .unit = "S",                                              \
                 .meaning = "Standard deviation of a Gaussian prior of the weights, so that ssbroyden and "  \
                            "lbfgs do not learn the noise of the data; 0 for no prior"),                     \
        TRAINING(run_, adam_eps, REAL, .adam = true, .high = 1, .above = true, .methods = methods_,          \
                 VALUE("1e-12"), .unit = "EPS", .meaning = "Adam's eps"),                                    \
        TRAINING(run_, clip, REAL, .adam = true, .high = 1e300, .methods = methods_, VALUE("1e-3"),          \
                 .unit = "NORM", .meaning = "Bound on the gradient's norm; 0 for no bound"),                 \
        TRAINING(run_, shards, U32, .high = 1024, .methods = methods_, VALUE("0"), .unit = "n",              \
                 .meaning = "Number of pieces of a batch, which threads work on; 0 chooses 1 to 4 by the "   \
                            "amount of work; the bits of the result depend on this number"),                 \
        TRAINING(run_, patience, U64, .high = 1e9, .optional = true, .methods = methods_, VALUE("0"),        \
                 .unit = "E",                                                                                \
                 .meaning =                                                                                  \
                     "Stop after this many epochs (adam) or accepted steps (other methods) without a lower " \
                     "loss, which is the loss of the validation part if there is one; 0 for never"),         \
        TRAINING(run_, seed, U64, .high = 0x1p64, .option = "", .value = "1", .unit = "S",                   \
                 .meaning = "Seed of all random numbers")
#define METHODS_FOR_squares  lg_fit_method_name
#define METHODS_FOR_any_loss lg_plan_name_any_loss
#define PRIOR_FOR_squares    "prior"
#define PRIOR_FOR_any_loss   ""

/* Rows that some kinds of models have in common. */
#define VALIDATION(run_, ...) TRAINING(run_, validation, REAL, PART_FOR_VALIDATION, __VA_ARGS__)
#define PART_FOR_VALIDATION                                                                                  \
    .option = "validation-fraction", .high = 0.9, .unit = "F",                                               \
    .meaning = "Fraction kept for validation; the parameters of the best epoch are then the result"
#define TEST_FRACTION(run_, meaning_, ...)                                                                   \
    LG_FIELD(run_, "run", "test_fraction", REAL, test_fraction, .unit = "F", .meaning = meaning_, __VA_ARGS__)
#define PENALTY_FORM(run_, ...) LG_FIELD(run_, "run", "penalty_form", NAME, __VA_ARGS__)
#define ACTIVATION(run_, member, meaning_, ...)                                                              \
    LG_FIELD(run_, "model", "activation", NAME, member, LG_NAMED(lg_activation_name, LG_ACTIVATION_COUNT),   \
             .meaning = meaning_, __VA_ARGS__)
/* Predictions by a scheme, of members with the names scheme, substeps, starts and window. */
#define SCHEME(run_, ...)                                                                                    \
    LG_FIELD(run_, "run", "integrator", NAME, scheme, .option = "scheme", .usual = true,                     \
             .value_name = lg_name_scheme, .value_at = lg_scheme_number,                                     \
             .meaning = "Scheme of the steps between two points of the data", __VA_ARGS__)
#define SUBSTEPS(run_, group_, type, ...)                                                                    \
    LG_FIELD(run_, group_, "substeps", type, substeps, .low = 1, .high = 1e6, .unit = "n",                   \
             .meaning = "Integrator steps between two points of the data", __VA_ARGS__)
#define WINDOW(run_, group_, type, ...)                                                                      \
    LG_FIELD(run_, group_, "window", type, window, .low = 2, .high = 1e9, .unit = "M", __VA_ARGS__)
#define INITIAL_STATES(run_, meaning_, ...)                                                                  \
    LG_FIELD(run_, "run", "starts", NAME, starts, .option = "initial-states",                                \
             LG_NAMES("measured", "estimated"), .meaning = "Where predictions start: at the " meaning_,      \
             __VA_ARGS__)

#define CONSTANT(text) .value = text
#define CHOSEN(text)   .otherwise = LG_CHOSEN
/* LG_CHOSEN: a default that depends on data or model; ": " and how may follow. LG_OF_PRESET begins a default
 * that presets set: lg_training_describe_field shows its value. */
#define LG_CHOSEN    "chosen by data and model"
#define LG_OF_PRESET "the preset's"
#define PRESET(text) .otherwise = LG_OF_PRESET
/* A preset may replace this value. */
#define REPLACED(text) .value = text, .otherwise = LG_OF_PRESET "; thesis: " text

/* Schemes of integrators as values of a field: the name of number `value`, NULL beyond the last, and the
 * scheme. */
const char *lg_name_scheme(uint32_t value);
const void *lg_scheme_number(uint32_t value);

/* Training plans as fields. _squares accepts the methods for losses that are sums of squares, _any_loss only
 * the methods for any loss. */
lg_status lg_plan_parse_squares(const char *text, void *member, lg_error *error);
lg_status lg_plan_parse_any_loss(const char *text, void *member, lg_error *error);
const char *lg_plan_name_any_loss(uint32_t value);
void lg_plan_show(const void *member, char *text, size_t size);

#endif
