/* Fragments of C that several operations need. */
#include "autodiff/ops/op_c.h"

#include <string.h>

const char *lg_c_text_of(const char *name) {
    for (const lg_c_text *t = lg_c_texts; t->name != NULL; t++)
        if (strcmp(t->name, name) == 0) return t->text;
    return "#error missing fragment\n";
}

const lg_c_fragment lg_c_dot = {.file = {"dot", "dot"}};
const lg_c_fragment lg_c_dense_add = {.file = {"dense_add", "dense_add"}, .needs = {&lg_c_dot}};
static const lg_c_fragment inverse_factorial = {.file = {"inverse_factorial", "inverse_factorial"}};
static const lg_c_fragment stumpff_series = {.file = {"stumpff_series", "stumpff_series"},
                                             .needs = {&inverse_factorial}};
static const lg_c_fragment stumpff = {.file = {"stumpff", "stumpff"}, .needs = {&stumpff_series}};
const lg_c_fragment lg_c_stumpff = {.file = {"stumpff_row", "stumpff_row"}, .needs = {&stumpff}};
const lg_c_fragment lg_c_dexpinv = {.file = {"dexpinv", "dexpinv"}};
