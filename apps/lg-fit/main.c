/* lg-fit: regression and classification of tables. */
#include "lg-fit/fit.h"

int main(int argc, char **argv) {
    const app_command commands[] = {
        train_command, evaluate_command, predict_command, search_command, {.run = NULL}};
    return app_main(
        argc, argv, "lg-fit",
        "Networks that learn a table: regression of its columns, or the class of a row. Tables are CSV, "
        "HDF5 or numpy files; columns have names.",
        commands);
}
