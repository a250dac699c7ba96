/* What exported models are for. A new target is a row here. */
#include "lg-export/export.h"

const char *const export_target_names[] = {"c",    "casadi",      "fmu2",    "fmu3", "simulink",
                                           "onnx", "safetensors", "package", NULL};
const export_target export_targets[] = {
    NULL, export_casadi, export_fmu2, export_fmu3, export_simulink, export_onnx, export_safetensors, NULL};
