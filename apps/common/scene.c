/* Draws the start of a scene that has none. */
#include "common/app.h"
#include "liegrad/mechanics.h"

void app_scene_start(const app *self, lg_scene *scene, const char *path) {
    if (scene->has_initial) return;
    const lg_status status = lg_scene_draw_start(scene, self->seed);
    if (status == LG_UNSUPPORTED)
        app_stop(
            self, LG_FORMAT,
            "%s: the key `initial` is missing, and no start of this kind can be drawn at random for this "
            "system: give `initial`",
            path);
    app_must_file(self, status, NULL, path);
    app_warn(self, "%s: the key `initial` is missing: the start is drawn with seed %llu", path,
             (unsigned long long)self->seed);
}
