/* For the files behind h5.h. h5_read.c, h5_texts.c and h5_write.c use h5.c; h5_texts.c opens data sets with
 * h5_read.c. There are no other calls between them. */
#ifndef LG_H5_INTERNAL_H
#define LG_H5_INTERNAL_H

#include "files/h5.h"

/* By how many bytes a file in memory grows. */
#define LG_CORE_INCREMENT ((size_t)1 << 20)

/* HDF5 prints no messages between begin and end; end restores the setting before. */
typedef struct lg_h5_quiet {
    H5E_auto2_t report;
    void *user;
} lg_h5_quiet;

static inline lg_h5_quiet lg_quiet_begin(void) {
    lg_h5_quiet quiet = {NULL, NULL};
    (void)H5Eget_auto2(H5E_DEFAULT, &quiet.report, &quiet.user);
    (void)H5Eset_auto2(H5E_DEFAULT, NULL, NULL);
    return quiet;
}

static inline void lg_quiet_end(lg_h5_quiet quiet) {
    (void)H5Eclear2(H5E_DEFAULT);
    (void)H5Eset_auto2(H5E_DEFAULT, quiet.report, quiet.user);
}

/* A data set that is open. Between lg_quiet_begin and lg_quiet_end only. */
typedef struct lg_dataset {
    hid_t set, type;
    uint32_t rank;
    uint64_t dims[LG_MAX_RANK], count;
} lg_dataset;

/* A data set of any type; LG_FORMAT when it exceeds max_size with `bytes` an element. *d may be closed after
 * a failure too. */
lg_status lg_dataset_open(lg_h5 *h5, const char *name, size_t bytes, lg_dataset *d, lg_error *error);
void lg_dataset_close(lg_dataset *d);
/* LG_FORMAT with the data set's name. */
lg_status lg_dataset_error(const lg_h5 *h5, const char *name, const char *what, lg_error *error);
/* Every link on the way exists and the last one leads to an object. */
bool lg_path_exists(lg_h5 *h5, const char *name);

bool lg_is_number(hid_t type); /* a sound type of floats or integers */
bool lg_is_whole(double x);
hid_t lg_h5_memory_type(lg_element type); /* native, not to be closed */
size_t lg_element_size(lg_element type);
/* A handle without a file: path copied, link access list made. */
lg_status lg_h5_new(const lg_context *context, const char *path, lg_h5 **out, lg_error *error);

#endif
