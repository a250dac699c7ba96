/* Programs in files. Parameters are below /parameters, functions as bytes (liegrad/program_image.h) below
 * /functions, by name; attribute `order` of these groups has their order. The numbers of a parameter may lie
 * in other places of the file. Then /parameters has an attribute with the parameter's name: a list of
 * places, each one with or without a word:
 *   model/layer1/weight          the numbers as they are
 *   single scaler/mean           rounded to single precision; 0 where that is not finite
 *   rest scaler/mean             the number less what `single` gives
 *   inverse scaler/scale         1 over the number
 * The parameter is the vector of these numbers, place after place. So no number is stored twice. */
#ifndef LG_PROGRAM_FILE_H
#define LG_PROGRAM_FILE_H

#include "files/h5.h"
#include "liegrad/integrators.h"
#include "liegrad/program_image.h"

enum { LG_PROGRAM_NAME = 65, LG_PROGRAM_MOST_NAMES = 1024 };

/* A path in the file; all are shorter than this. */
typedef struct lg_program_key {
    char text[256];
} lg_program_key;
lg_program_key lg_program_below(const char *group, const char *name);
lg_status lg_program_no_memory(const lg_h5 *h5, lg_error *error);
/* The numbers of places in a file: the text of a parameter, and what it becomes. */
enum { LG_PROGRAM_PLACE = 64 };
typedef struct lg_program_source {
    const char *parameter, *place; /* "scale", "inverse scaler/scale" */
} lg_program_source;
/* What a word makes of a number; the word's end in the place. */
typedef double (*lg_program_word)(double x);
lg_program_word lg_program_word_of(const char *place, const char **rest);

/* Texts of at most 64 bytes: names, units. */
typedef struct lg_program_texts {
    char (*text)[LG_PROGRAM_NAME];
    size_t count;
} lg_program_texts;

typedef struct lg_program_reading {
    lg_h5 *h5;
    size_t left; /* bytes that may still be taken */
    lg_program *program;
    lg_program_texts parameters, functions; /* names in order */
    lg_error *error;
} lg_program_reading;

lg_status lg_program_bad(const lg_program_reading *r, const char *path, const char *what);
/* Missing keys and wrong shapes become LG_FORMAT. */
lg_status lg_program_as_format(const lg_program_reading *r, lg_status status);
/* Memory within the limit. */
lg_status lg_program_take(lg_program_reading *r, const char *path, uint64_t count, size_t size, void **out);
/* At most `most` texts of the data set `path`, or, if `attribute` is not NULL, of this attribute of the
 * group. To be freed; NULL after a failure. */
lg_status lg_program_get_texts(lg_program_reading *r, const char *path, const char *attribute, size_t most,
                               lg_program_texts *out);
/* Adds the function at `path` to the program. */
lg_status lg_program_add(lg_program_reading *r, const char *path, const lg_function_image *image);

/* Functions and their order; parameters and their order. `places`: of the parameters that lie elsewhere, in
 * their order, `count` rows. */
lg_status lg_program_put_functions(lg_h5 *h5, const lg_program *program, lg_error *error);
lg_status lg_program_put_parameters(lg_h5 *h5, const lg_program *program, const lg_program_source *places,
                                    size_t count, lg_error *error);
/* The attribute `space` of a model. */
lg_status lg_program_put_space(lg_h5 *h5, const lg_space *space, lg_error *error);
/* The program of an open file of any kind. */
lg_status lg_program_get(lg_h5 *h5, lg_program **out, lg_error *error);

/* The functions of a file of format 1. */
lg_status lg_program_get_functions_1(lg_program_reading *r);

#endif
