/* What exported models are for. A new target is a row here. */
#include "lg-export/export.h"

const export_target export_targets[] = {{"casadi", export_casadi}, {NULL, NULL}};
