/* What files of each kind are, for messages. */
#include <string.h>

#include "core/core.h"
#include "files/h5.h"
#include "files/read_file.h"

static const struct {
    const char *kind, *what;
} kinds[] = {
    {"", "the file does not say what it is (attribute kind)"},
    {"hamiltonian", "it is a learned Hamiltonian, for lg-learn, lg-export or lg_model_load"},
    {"surrogate", "it is a model of beams, for lg-elastica, lg-learn or lg_model_load"},
    {"detector", "it is a detector, for lg-anomaly or lg_model_load"},
    {"classifier", "it is a classical classifier, for lg-anomaly or lg_classifier_load"},
    {"table", "it is a model of a table, for lg-fit or lg_model_load"},
    {"machine_model", "it is a learned machine, for lg-identify or lg_model_load"},
    {"policy", "it is a controller, for lg-control, lg-export or lg_policy_load"},
    {"program", "it is a program of functions, for lg-export or lg_program_load"},
    {"trajectories", "it is a data file with trajectories"},
    {"trajectory", "it is a data file with a trajectory"},
    {"elastica", "it is a data file with curves of the elastica"},
    {"series", "it is a data file with labelled series"},
};

const char *lg_h5_what_is(const char *kind) {
    for (size_t i = 0; i < LG_COUNT(kinds); i++)
        if (strcmp(kinds[i].kind, kind) == 0) return kinds[i].what;
    return "its kind is unknown";
}
