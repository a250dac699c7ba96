/* Training of a program: the parameters that minimise what one of its functions computes from rows of data.
 *
 *   lg_program_build(NULL, &spec, &program, &error);            `value` and `error` = value - wanted
 *   const double *const data[] = {x, wanted};
 *   lg_program_train(NULL, program, "error", data, rows, NULL, NULL, &error);
 *   lg_program_save(NULL, "model.h5", program, NULL, &error);   (liegrad/io.h)
 *
 * A program that was loaded is trained on in the same way.
 */
#ifndef LIEGRAD_TRAIN_H
#define LIEGRAD_TRAIN_H

#include "liegrad/nn.h"
#include "liegrad/program.h"

LG_BEGIN_DECLS

#define LG_TRAIN_MOST 64 /* parameters (tensors), inputs, outputs */

typedef struct lg_program_training {
    double before, after; /* the loss of all training rows */
    double seconds;
    uint64_t epochs; /* of methods other than Adam: evaluations */
    const char *end; /* why training is finished, a sentence of static storage without a full stop */
} lg_program_training;

/* The first output of `function` says what is minimised:
 *   one value for each row (B, ...)   the mean of its squares over rows and numbers
 *   one number that all rows share    itself; it must be a mean over the rows, as lg_mean makes it
 * Both are tried before and after training: the loss of 8 rows, from all over the data, must be the mean
 * of the losses of each row alone. A sum is refused, and so are rows that depend on each other: rows are
 * trained on in chunks, and the result would follow the chunks.
 * data[i]: input i of the function, (rows, numbers of one row); a shared input is there once.
 *
 * options NULL: in double precision, by Levenberg-Marquardt where there are squares and at most 64
 * parameters, else SSBroyden with at most 2000, else L-BFGS; 1000 evaluations, fewer where the loss no longer
 * falls. All of lg_fit_options is honoured: threads, validation part with keep_best, seconds, methods.
 *
 * Success replaces the program's parameters (lg_program_set_parameter). `result` may be NULL. Errors, the
 * program as before: LG_NOT_FOUND (function), LG_INVALID_ARGUMENT (no rows, NULL, an output that depends on
 * no parameter, that has several numbers which rows share, or that is no mean over rows), LG_UNSUPPORTED
 * (LG_TRAIN_MOST), LG_NOT_FINITE (data, and as lg_fit_run), those of lg_fit_create, lg_fit_run and of
 * operations. */
LG_API lg_status lg_program_train(const lg_context *context, lg_program *program, const char *function,
                                  const double *const *data, size_t rows, const lg_fit_options *options,
                                  lg_program_training *result, lg_error *error);

LG_END_DECLS

#endif
