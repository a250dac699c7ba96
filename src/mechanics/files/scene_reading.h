/* The keys that the system of a scene allows, with their values, and the state of reading the scene. */
#ifndef LG_SCENE_READING_H
#define LG_SCENE_READING_H

#include "mechanics/files/scene.h"

#define LG_SCENE_MAX_KEYS 48

typedef struct scene_table {
    const char *system, *form;
    const lg_parameter_entry *parameters;
    const lg_state_entry *parts;
    /* For chains: the file may give omega in place of p, or p in place of omega, which is then converted.
     * own_key is the key of the system's form, other_key the other one; NULL for other systems. */
    const char *own_key, *other_key;
    size_t links_at, parameters_at, parts_at, other_at; /* indices in `keys`; 0: there is no such key */
    char title[160];                                    /* for messages: "heavy-top (direct)" */
    size_t count;
    lg_field keys[LG_SCENE_MAX_KEYS];
    lg_key_value values[LG_SCENE_MAX_KEYS];
    char names[LG_SCENE_MAX_KEYS][32];
} scene_table;

typedef struct reading {
    const lg_context *context;
    lg_yaml *yaml;
    const scene_table *table;
    size_t links; /* 0 if the system has no links */
    lg_scene *out;
    lg_error *error;
} reading;

/* Fails with LG_FORMAT and a sentence that begins with the file and this line. */
#define LG_SCENE_FAULT(r, line, ...) lg_yaml_fail((r)->yaml, line, LG_FORMAT, (r)->error, __VA_ARGS__)

static inline size_t per_link(size_t count, size_t links) {
    return count != 0 ? count : links;
}

static inline lg_status lg_scene_no_memory(const reading *r) {
    return lg_fail(r->error, LG_OUT_OF_MEMORY, "%s: out of memory", lg_yaml_path(r->yaml));
}
/* Makes r->out->state from the values of `initial`. r->out->system must exist. */
lg_status lg_scene_read_start(reading *r);

#endif
