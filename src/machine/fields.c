/* The hyperparameters of a learned machine. */
#include "liegrad/machine.h"

#include "settings/training.h"

#define MACHINE(name, type, member, ...)                                                                     \
    LG_FIELD(lg_machine_model_run, "run", name, type, member, __VA_ARGS__)
const lg_field lg_machine_model_fields[] = {
    MACHINE("integrator", NAME, scheme, .option = "scheme", .usual = true, .value_name = lg_name_scheme,
            .value_at = lg_scheme_number, .value = "cf4",
            .meaning = "Scheme of the steps between two points of the data"),
    MACHINE("substeps", U32, substeps, .low = 1, .high = 1e6,
            .otherwise = LG_CHOSEN ": 1 to 4, so that the error of the steps is small against the loss",
            .unit = "n", .meaning = "Integrator steps between two points of the data"),
    MACHINE("window", U32, window, .usual = true, .low = 2, .high = 1e9,
            .otherwise = LG_CHOSEN
            ": 5; 20 with noise, 60 where positions, 200 where accelerations alone are measured",
            .unit = "M", .meaning = "Rows of a window: predictions start at its first row"),
    MACHINE("stride", U32, stride, .option = "hop", .high = 1e9,
            .otherwise =
                LG_CHOSEN ": M - 1, so that windows touch; less if that gives fewer than 2000 windows",
            .unit = "n", .meaning = "Rows from one window to the next"),
    MACHINE("starts", NAME, starts, .option = "initial-states",
            LG_NAMES([LG_MACHINE_STARTS_MEASURED] = "measured", [LG_MACHINE_STARTS_ESTIMATED] = "estimated"),
            .otherwise = LG_CHOSEN
            ": estimated where the machine's `noise` is given, or positions or accelerations alone are "
            "measured",
            .meaning = "Where predictions start: at the logged rows, or at estimated states near them"),
    TRAINING_ROWS(lg_machine_model_run, "method", squares, "Windows", 0, CONSTANT, CHOSEN),
    TRAINING(lg_machine_model_run, validation, REAL, .value = "0", .json = "validation-part", VALIDATION),
    LG_FIELD_END};
