/* Changes YAML files: sets, appends or replaces pieces and writes the text again. */
#ifndef LG_YAML_EDIT_H
#define LG_YAML_EDIT_H

#include "core/core.h"

typedef enum lg_yaml_how {
    /* The value of the key becomes the fragment. */
    LG_YAML_SET,
    /* The fragment becomes one more item of the key's list. A value that is not a list becomes its first
     * item; an absent value, or the word `none`, gives way to the fragment. */
    LG_YAML_APPEND,
    /* As LG_YAML_APPEND, but the fragment takes the place of an item that it knows by its name `old`: the
     * keys of the fragment are set in an item with `kind: old` (if the fragment has the key `of`, in one with
     * the same `of`); an item that is the word `old` gives way. */
    LG_YAML_REPLACE
} lg_yaml_how;

typedef struct lg_yaml_edit {
    lg_yaml_how how;
    const char *path; /* keys of mappings, as in "inputs.hold"; mappings that are missing are made */
    const char *old;  /* LG_YAML_REPLACE: a name; else NULL */
    const char *fragment;
} lg_yaml_edit;

/* Writes the text of a YAML file after the edits, which the caller frees with lg_free. Everything else stays
 * as it is, except for comments, which are lost. `name` stands for the file in messages. Errors: LG_FORMAT
 * (text or fragment are not YAML; a key on the path has a value that is not a mapping), LG_OUT_OF_MEMORY. */
lg_status lg_yaml_change(const lg_context *context, const char *name, const char *text,
                         const lg_yaml_edit *edits, size_t count, char **out, lg_error *error);

#endif
