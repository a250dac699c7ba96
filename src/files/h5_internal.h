/* Shared by the files that implement h5.h. All of them use h5.c. h5_attributes.c and h5_texts.c also use
 * h5_read.c. */
#ifndef LG_H5_INTERNAL_H
#define LG_H5_INTERNAL_H

#include "liegrad/tape.h"

#include "files/h5.h"

/* Bytes by which HDF5 enlarges a file in memory. */
#define LG_CORE_INCREMENT ((size_t)1 << 20)

/* The name of a file in memory. HDF5 takes two open files of one name for the same file, and it accepts an
 * image in memory only under the name of a file that does not exist. */
typedef struct lg_h5_name {
    char text[64];
} lg_h5_name;
lg_h5_name lg_h5_memory_name(const lg_h5 *h5);

/* Functions of HDF5 that get an invalid identifier do nothing and fail. So the code uses an identifier
 * without checking whether the call that made the identifier failed. An identifier that is declared by LG_ID
 * is closed where its block ends.
 *
 * HDF5 prints no messages from LG_QUIET to the end of the block, which restores the previous setting. */
#define LG_ID    LG_CLEAN(lg_id_close) hid_t
#define LG_QUIET LG_CLEAN(lg_quiet_end) const lg_h5_quiet quiet_ = lg_quiet_begin()
static inline void lg_id_close(const hid_t *id) {
    if (*id >= 0) (void)H5Idec_ref(*id);
}
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

static inline void lg_quiet_end(const lg_h5_quiet *quiet) {
    (void)H5Eclear2(H5E_DEFAULT);
    (void)H5Eset_auto2(H5E_DEFAULT, quiet->report, quiet->user);
}

/* An open data set, which LG_DATASET declares and closes where the block ends. Use it only after LG_QUIET. */
typedef struct lg_dataset {
    hid_t set, type;
    const char *member; /* of a table with named members: the one that is read, with its `type`; else NULL */
    uint32_t rank;
    uint64_t dims[LG_MAX_RANK], count;
} lg_dataset;

#define LG_DATASET(name)                                                                                     \
    LG_CLEAN(lg_dataset_close) lg_dataset name = {.set = H5I_INVALID_HID, .type = H5I_INVALID_HID}

/* Opens the data set of a slice, checks that the slice lies in it, and selects the slice in *part. The caller
 * closes both, also after a failure. */
lg_status lg_slice_open(lg_h5 *h5, const lg_h5_slice *slice, size_t bytes, lg_dataset *d, hid_t *part,
                        lg_error *error);
void lg_dataset_close(const lg_dataset *d);
/* Makes the type in memory of one element of the data set: `type`, or a record with one member of this type.
 * The caller closes it. */
hid_t lg_dataset_memory(const lg_dataset *d, hid_t type);
/* Fails with LG_FORMAT and a message that names the data set. */
lg_status lg_dataset_error(const lg_h5 *h5, const char *name, const char *what, lg_error *error);
#define LG_NO_NUMBERS "does not hold numbers: write an array of integers or floating-point numbers"
#define LG_NO_CELLS   "holds neither numbers nor texts: write an array of numbers or of strings"
/* Writes a shape as "(3, 4)". */
enum { LG_SHAPE_TEXT = 8 + LG_MAX_RANK * 22 }; /* bytes that the longest shape takes */
void lg_shape_text(char text[LG_SHAPE_TEXT], uint32_t rank, const uint64_t *dims);
/* True if every link of the path exists and the last one leads to an object, and for "", the root group. Also
 * true if HDF5 cannot tell: then reading the object fails. */
bool lg_path_exists(lg_h5 *h5, const char *name);
/* True if the object exists and has the attribute, or if HDF5 cannot tell. */
bool lg_attribute_exists(lg_h5 *h5, const char *object, const char *name);

bool lg_is_number(hid_t type); /* true for undamaged floating-point and integer types */
bool lg_is_whole(double x);
hid_t lg_h5_long_type(hid_t stored); /* the native integer of 8 bytes with the sign of `stored` */
/* The native type and the type in files of an element, which must not be closed. */
hid_t lg_h5_memory_type(lg_element type);
hid_t lg_h5_file_type(lg_element type); /* negative for a value that is no element */
size_t lg_element_size(lg_element type);
/* Creates a handle that has no file yet. It copies the path and creates the link access list. */
lg_status lg_h5_new(const lg_context *context, const char *path, lg_h5 **out, lg_error *error);

#endif
