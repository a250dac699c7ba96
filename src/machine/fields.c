/* The hyperparameters of a learned machine. */
#include "liegrad/machine.h"

#include "settings/training.h"

#define MACHINE(name, type, member, ...)                                                                     \
    LG_FIELD(lg_machine_model_run, "run", name, type, member, __VA_ARGS__)
const lg_field lg_machine_model_fields[] = {
    SCHEME(lg_machine_model_run, .value = "cf4"),
    SUBSTEPS(lg_machine_model_run, "run", U32,
             .otherwise = LG_CHOSEN ": 1 to 4, so that the error of the steps is small against the loss"),
    WINDOW(lg_machine_model_run, "run", U32, .usual = true,
           .otherwise =
               LG_CHOSEN ": 5; 20 with noise, 60 where positions, 200 where accelerations alone are measured",
           .meaning = "Rows of a window: predictions start at its first row"),
    MACHINE("stride", U32, stride, .option = "hop", .high = 1e9,
            .otherwise =
                LG_CHOSEN ": M - 1, so that windows touch; less if that gives fewer than 2000 windows",
            .unit = "n", .meaning = "Rows from one window to the next"),
    INITIAL_STATES(lg_machine_model_run, "logged rows, or at estimated states near them",
                   .otherwise = LG_CHOSEN
                   ": estimated with noise, and where positions or accelerations alone are measured"),
    TRAINING_ROWS(lg_machine_model_run, "method", squares, "Windows", 0, CONSTANT, CHOSEN),
    VALIDATION(lg_machine_model_run, .value = "0", .json = "validation-part"),
    LG_FIELD_END};
