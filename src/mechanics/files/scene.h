/* Reads scenes that are part of other files: a study grid has the keys of a scene at its top level. */
#ifndef LG_SCENE_H
#define LG_SCENE_H

#include "liegrad/mechanics.h"

#include "settings/files/yaml.h"

/* Reads the top-level mapping, which has the keys of a scene and those in `more` (may be NULL). form_wanted
 * is as in lg_scene_read. */
lg_status lg_scene_from(const lg_context *context, lg_yaml *yaml, const char *form_wanted,
                        const lg_key_set *more, lg_scene *out, lg_error *error);

#endif
