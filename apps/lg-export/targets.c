/* What exported models are for. A new target is a row here. */
#include "lg-export/export.h"

/* Name, what fills the files, what is added to those of C, whether a scene's parameters are inputs. */
#define TARGETS(ROW)                                                                                         \
    ROW("c", NULL, NULL, false)                                                                              \
    ROW("casadi", export_casadi, NULL, false)                                                                \
    ROW("fmu2", export_fmu2, NULL, true)                                                                     \
    ROW("fmu3", export_fmu3, NULL, true)                                                                     \
    ROW("simulink", export_simulink, NULL, false)                                                            \
    ROW("onnx", export_onnx, NULL, false)                                                                    \
    ROW("safetensors", export_safetensors, NULL, false)                                                      \
    ROW("package", NULL, export_add_package, false)

#define NAME_OF(name, build, add, tunable) name,
const char *const export_target_names[] = {TARGETS(NAME_OF) NULL};
#define ROW_OF(name, build, add, tunable) {name, build, add, tunable},
const export_target export_targets[] = {TARGETS(ROW_OF)};
