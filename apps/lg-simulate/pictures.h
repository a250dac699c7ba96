/* Declarations that the pictures of a run share: panels in the plane (pictures.c) and in space (space.c). */
#ifndef LG_APPS_SIMULATE_PICTURES_H
#define LG_APPS_SIMULATE_PICTURES_H

#include "lg-simulate/simulate.h"

typedef struct drawing {
    const report *what;
    app_plot plot;
} drawing;

/* The state at point i of the trajectory, and its time. */
const double *state_at(const drawing *from, size_t i);
double time_at(const drawing *from, size_t i);

typedef struct space_picture {
    const char *system;
    void (*draw)(drawing *to); /* begins the picture and writes its data */
} space_picture;
/* NULL if there is no 3d picture of this system. */
const space_picture *find_space_picture(const simulation *sim);

#endif
