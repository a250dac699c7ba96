/* Old spellings of options. They are accepted where the new ones are, on command lines and in files of
 * searches; --help does not list them. */
#include "common/app.h"

/* The first row that fits is used. */
const app_alias app_aliases[] = {{"lg-anomaly", "method", "classifier", NULL},
                                 {"lg-anomaly", "picture", "plot-kind", NULL},
                                 {"lg-simulate", "method", "scheme", NULL},
                                 {"lg-simulate", "methods", "schemes", NULL},
                                 {"lg-simulate", "starts", "members", NULL},
                                 {"lg-simulate", "tol", "tolerance", NULL},
                                 {"lg-control certify", "continuous", "loop", "continuous"},
                                 {"lg-control certify", "held", "loop", "held"},
                                 {"lg-control certify", "precision", "dtype", NULL},
                                 {"lg-control evaluate", "runs", "out", NULL},
                                 {"lg-control train", "starts", "batch", NULL},
                                 {"lg-identify adapt", "seconds", "beginning", NULL},
                                 {"lg-identify fit", "validation", "validation-logs", NULL},
                                 {"lg-identify generate", "inputs", "excitation", NULL},
                                 {"lg-export", "sensor", "noise", NULL},
                                 {"lg-gradcheck", "plant", "plant-errors", NULL},
                                 {"", "gamma", "penalty", NULL},
                                 {"", "integrator", "scheme", NULL},
                                 {"", "method", "optimizer", NULL},
                                 {"", "network", "architecture", NULL},
                                 {"", "resume", "continue", NULL},
                                 {"", "starts", "initial-states", NULL},
                                 {"", "stride", "hop", NULL},
                                 {"", "validation", "validation-fraction", NULL},
                                 {"", "validation-part", "validation-fraction", NULL},
                                 {NULL, NULL, NULL, NULL}};
