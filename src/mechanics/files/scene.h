/* Scenes inside other files: a study grid has the keys of a scene at its top. */
#ifndef LG_SCENE_H
#define LG_SCENE_H

#include "settings/files/yaml.h"

/* Reads the top mapping as a scene plus the keys of `more` (may be NULL); form_wanted as in lg_scene_read. */
lg_status lg_scene_from(const lg_context *context, lg_yaml *yaml, const char *form_wanted,
                        const lg_key_set *more, lg_scene *out, lg_error *error);

#endif
