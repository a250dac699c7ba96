/* Model files of machines, written by `lg-identify fit`: the machine's YAML, scales, ranges of the data and
 * parameters. Library liegrad_io. */
#ifndef LIEGRAD_MACHINE_MODEL_H
#define LIEGRAD_MACHINE_MODEL_H

#include "liegrad/fields.h"
#include "liegrad/io.h"
#include "liegrad/logs.h"
#include "liegrad/machine.h"

LG_BEGIN_DECLS

#define LG_MACHINE_TEXT 4096 /* bytes of a YAML text in a model file, with its terminator */

/* Smallest and largest number of each position, velocity and input in the training logs, in this order. */
#define LG_MACHINE_RANGE (LG_MACHINE_POSITIONS + LG_MACHINE_VELOCITIES + LG_MACHINE_INPUTS)
typedef struct lg_machine_range {
    double low[LG_MACHINE_RANGE], high[LG_MACHINE_RANGE];
} lg_machine_range;

typedef struct lg_machine_model_run {
    lg_machine machine;         /* made from `text` and `scales` */
    char text[LG_MACHINE_TEXT]; /* the machine's YAML without comments */
    lg_machine_scales scales;
    lg_machine_range range;
    const lg_scheme *scheme; /* of the library: attribute `integrator` */
    uint32_t substeps, window, stride;
    lg_machine_starts starts;
    double position_scale[LG_MACHINE_COORDINATES]; /* of the loss, in the units of the log */
    double velocity_scale[LG_MACHINE_COORDINATES];
    uint32_t delay; /* rows by which inputs act later than they are logged */
    lg_training training;
    uint64_t windows;
    double dt; /* median */
    char data_sha256[LG_SHA256_TEXT];
} lg_machine_model_run;

typedef struct lg_machine_model_file {
    lg_machine_model_run run;
    size_t parameters; /* run.machine.parameters */
    double *theta;     /* (parameters), in the machine's scaled units */
    double *spread;    /* (parameters, parameters), of lg_identification; NULL: not known */
    size_t epochs_done;
    double *history[LG_FIT_SERIES_COUNT]; /* as in lg_hamiltonian_file */
    lg_provenance provenance;
    const lg_context *context; /* whose memory the arrays are in */
} lg_machine_model_file;

/* Hyperparameters of lg_machine_model_run, and its kind for lg_checkpoint_create and lg_checkpoint_open. */
LG_API extern const lg_field lg_machine_model_fields[];
LG_API extern const lg_recipe lg_recipe_machine_model;

/* The YAML without comments and blank lines; LG_FORMAT when it is longer than LG_MACHINE_TEXT. */
LG_API lg_status lg_machine_model_describe(lg_machine_model_run *run, const char *name, const char *text,
                                           lg_error *error);

/* SHA-256 of the rows of a log as little-endian doubles. */
LG_API void lg_machine_log_sha256(const lg_machine *machine, const lg_machine_log *log,
                                  char text[LG_SHA256_TEXT]);
/* The range of the rows of a log. */
LG_API void lg_machine_find_range(const lg_machine *machine, const lg_machine_log *log,
                                  lg_machine_range *out);

LG_API lg_status lg_model_save_machine_model(const lg_context *context, const char *path,
                                             const lg_machine_model_file *file, const lg_fit *fit,
                                             lg_error *error);
LG_API lg_status lg_model_load_machine_model(const lg_context *context, const char *path,
                                             const lg_read_options *options, lg_machine_model_file *out,
                                             lg_error *error);
LG_API void lg_machine_model_file_destroy(lg_machine_model_file *file);

LG_END_DECLS

#endif
