/* programs FOLDER: makes every model of this folder, derives functions from it, saves it as FOLDER/<name>.h5,
 * loads the file and continues training. `driven` is also saved as a model that moves. */
#include <stdio.h>

#include <liegrad/program.h>

#include "programs.h"

static const struct {
    const char *name, *function; /* function: the one that is differentiated */
    lg_status (*make)(lg_program **out, training *how, lg_error *error);
    int (*also)(const char *folder, lg_program *program); /* further use of the program; may be NULL */
} models[] = {{"throw", "value", make_throw, NULL},
              {"driven", "step", make_driven, moves},
              {"attitude", "step", make_attitude, NULL},
              {"waveforms", "value", make_waveforms, NULL}};

/* A loaded program can be run, trained further, differentiated and exported like the one that was made. */
static int save_load_and_train(const char *path, const lg_program *program, const char *function,
                               training how) {
    lg_program *again = NULL;
    lg_error error;
    double first = 0, last = 0;
    how.steps = 100;
    how.rate *= 0.1;
    lg_status status = lg_program_save(NULL, path, program, NULL, &error);
    if (status == LG_OK) status = lg_program_load(NULL, path, NULL, &again, &error);
    const int equal = status == LG_OK && same(program, again, function);
    if (status == LG_OK) status = train(again, &how, &first, &last, &error);
    if (status != LG_OK) (void)fprintf(stderr, "%s\n", error.message);
    (void)printf("  saved, loaded, trained on: loss %.3g, then %.3g\n", first, last);
    lg_program_destroy(again);
    return equal && status == LG_OK && last < first;
}

int main(int argc, char **argv) {
    int good = 1;
    if (argc != 2) {
        (void)fprintf(stderr, "usage: programs FOLDER\n");
        return 2;
    }
    for (size_t i = 0; i < sizeof models / sizeof *models && good; i++) {
        lg_program *program = NULL;
        training how;
        lg_error error;
        char path[1024];
        (void)snprintf(path, sizeof path, "%s/%s.h5", argv[1], models[i].name);
        error.message[0] = '\0';
        const lg_status status = models[i].make(&program, &how, &error);
        if (status != LG_OK) {
            (void)fprintf(stderr, "%s: %s\n", models[i].name,
                          error.message[0] != '\0' ? error.message : lg_status_sentence(status));
            return 1;
        }
        (void)printf("%s: %s\n", models[i].name, lg_program_description(program));
        good = use(program, models[i].function) &&
               save_load_and_train(path, program, models[i].function, how) &&
               (models[i].also == NULL || models[i].also(argv[1], program));
        lg_program_destroy(program);
    }
    return good && proofs() ? 0 : 1;
}
