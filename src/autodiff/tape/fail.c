/* The first error of a tape: its status, and a message with the operation, the shapes and the scope. */
#include <stdio.h>
#include <string.h>

#include "autodiff/tape/tape_internal.h"

lg_status lg_tape_status(const lg_tape *tape) {
    return tape != NULL ? tape->status : LG_INVALID_ARGUMENT;
}

const char *lg_tape_message(const lg_tape *tape) {
    return tape->message;
}

void lg_scope_push(lg_tape *tape, const char *name) {
    if (tape->scope_depth < LG_SCOPE_DEPTH) tape->scopes[tape->scope_depth] = name;
    tape->scope_depth++;
}

void lg_scope_pop(lg_tape *tape) {
    if (tape->scope_depth > 0) tape->scope_depth--;
}

void lg_tape_append(char *text, size_t size, const char *more) {
    size_t used = strlen(text);
    (void)snprintf(text + used, size - used, "%s", more);
}

lg_status lg_tape_needs(lg_tape *tape, const char *operation, bool all) {
    if (tape == NULL) return LG_INVALID_ARGUMENT;
    if (!all) (void)lg_tape_fail(tape, LG_INVALID_ARGUMENT, operation, "an argument is NULL");
    return tape->status;
}

lg_status lg_tape_conclude(const lg_tape *tape, lg_status status, lg_error *error) {
    if (status == LG_OK) return LG_OK;
    const bool of_tape = tape != NULL && tape->status != LG_OK;
    return lg_fail(error, status, "%s", of_tape ? tape->message : lg_status_sentence(status));
}

lg_var lg_tape_fail(lg_tape *tape, lg_status status, const char *operation, const char *reason) {
    if (tape->status != LG_OK) return LG_NONE;
    tape->status = status;
    tape->failed_at = tape->count;
    (void)snprintf(tape->message, sizeof tape->message, "%s: %s", operation, reason);
    for (int i = 0; i < tape->scope_depth && i < LG_SCOPE_DEPTH; i++) {
        lg_tape_append(tape->message, sizeof tape->message, i == 0 ? ", in " : "/");
        lg_tape_append(tape->message, sizeof tape->message, tape->scopes[i]);
    }
    return LG_NONE;
}

void lg_append_shape(char *text, size_t size, const lg_shape *shape) {
    char number[16];
    lg_tape_append(text, size, "(");
    for (uint32_t i = 0; i < shape->rank; i++) {
        (void)snprintf(number, sizeof number, i == 0 ? "%u" : ", %u", shape->dims[i]);
        lg_tape_append(text, size, number);
    }
    lg_tape_append(text, size, ")");
}

lg_var lg_fail_shapes(lg_tape *tape, const char *operation, const lg_node *const *in, uint32_t inputs) {
    char reason[200] = "shapes do not fit: ";
    for (uint32_t i = 0; i < inputs && i < 4; i++) {
        if (i > 0) lg_tape_append(reason, sizeof reason, " and ");
        lg_append_shape(reason, sizeof reason, &in[i]->shape);
    }
    return lg_tape_fail(tape, LG_SHAPE, operation, reason);
}
