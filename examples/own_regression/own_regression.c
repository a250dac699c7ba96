/* own_regression TABLE.csv MODEL.h5: learns some columns of a table from others, saves the model, loads it
 * again and evaluates it. `lg-export MODEL.h5 --out DIR` turns the model into C. The names of the columns
 * and the width of the network's two hidden layers may be changed here: all sizes follow from them. */
#include <stdio.h>
#include <stdlib.h>

#include <liegrad/table.h>

#define COUNT(array) (sizeof(array) / sizeof *(array))
static const char *const in_names[] = {"angle", "speed", "height"};
static const char *const out_names[] = {"range", "top"};
enum { IN = COUNT(in_names), OUT = COUNT(out_names), WIDTH = 12 };
static lg_error error;

static void need(lg_status status) {
    if (status == LG_OK) return;
    (void)fprintf(stderr, "own_regression: %s\n",
                  *error.message ? error.message : lg_status_sentence(status));
    exit(1);
}

int main(int argc, char **argv) {
    lg_table_data x, y;
    lg_program *program;
    lg_table_fit_options how;
    lg_table_fit_result done;
    size_t incomplete;
    double predicted[OUT];
    if (argc != 3) return (void)fputs("usage: own_regression TABLE.csv MODEL.h5\n", stderr), 2;
    need(lg_table_read(NULL, argv[1], in_names, IN, NULL, NULL, &x, &error));
    need(lg_table_read(NULL, argv[1], out_names, OUT, NULL, NULL, &y, &error));
    need(lg_table_keep_complete((lg_table_data *[]){&x, &y}, 2, &incomplete, &error));
    if (incomplete > 0) printf("%zu incomplete rows left out\n", incomplete);
    lg_table_fit_options_init(&how);
    how.model.hidden[0] = how.model.hidden[1] = WIDTH;
    need(lg_table_fit(NULL, x.values, IN, y.values, OUT, x.rows, &how, &program, &done, &error));
    printf("noise of the table %.2g deviations\n", done.evidence.noise);
    if (!done.evidence.settled) puts("the training ended at its limit of evaluations");
    need(lg_program_save(NULL, argv[2], program, NULL, &error));
    need(lg_program_load(NULL, argv[2], NULL, &program, &error));
    need(lg_program_eval(NULL, program, "value", 1, (const double *[]){x.values}, (double *[]){predicted},
                         &error));
    for (int k = 0; k < OUT; k++)
        printf("row 1: %s %.4g, predicted %.4g\n", out_names[k], y.values[k], predicted[k]);
    return 0; /* the process ends and frees all memory */
}
