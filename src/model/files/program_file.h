/* Programs in files. Parameters are below /parameters; functions are below /functions, as bytes
 * (liegrad/program.h); both are found by name. Attribute `order` of these groups lists the names in
 * order.
 *
 * The numbers of a parameter may be stored elsewhere in the file, so that no number is stored twice. Then
 * /parameters has an attribute with the parameter's name, which lists places, each with or without a word in
 * front:
 *   model/layer1/weight          the numbers as they are
 *   single scaler/mean           rounded to single precision; 0 where the result is not finite
 *   rest scaler/mean             the number minus what `single` gives
 *   inverse scaler/scale         1 divided by the number
 * The parameter is the vector of the numbers of all places, one place after the other. */
#ifndef LG_PROGRAM_FILE_H
#define LG_PROGRAM_FILE_H

#include "files/h5.h"
#include "liegrad/integrators.h"
#include "liegrad/program.h"

enum { LG_PROGRAM_NAME = 65, LG_PROGRAM_MOST_NAMES = 1024 };

LG_AT(lg_program_destroy, lg_program)
LG_AT(lg_function_image_destroy, lg_function_image)

/* A path in the file; `text` has room for every path. */
typedef struct lg_program_key {
    char text[256];
} lg_program_key;
lg_program_key lg_program_below(const char *group, const char *name);
/* Writes the SHA-256 of a packed function, the text of its attribute sha256. */
void lg_program_hash(const void *bytes, size_t size, char text[LG_SHA256_TEXT]);
/* One place of a parameter whose numbers are stored elsewhere in the file. */
enum { LG_PROGRAM_PLACE = 64 };
typedef struct lg_program_source {
    const char *parameter, *place; /* such as "scale", "inverse scaler/scale" */
} lg_program_source;
/* What a word does to a number. lg_program_word_of finds the word of a place; *rest is the path after it. */
typedef double (*lg_program_word)(double x);
lg_program_word lg_program_word_of(const char *place, const char **rest);

typedef char lg_program_name[LG_PROGRAM_NAME];

/* Write functions and their order, or parameters and their order. `places`: `count` places of the parameters
 * that are stored elsewhere; the places of a parameter are in order. */
lg_status lg_program_put_functions(lg_h5 *h5, const lg_program *program, lg_error *error);
lg_status lg_program_put_parameters(lg_h5 *h5, const lg_program *program, const lg_program_source *places,
                                    size_t count, lg_error *error);
/* Writes the version of the format of models; lg_program_put_functions does so too. */
lg_status lg_program_put_version(lg_h5 *h5, lg_error *error);
/* Writes the attribute `space` of /model. */
lg_status lg_program_put_space(lg_h5 *h5, const lg_space *space, lg_error *error);
/* Reads the program of an open file of any kind. */
lg_status lg_program_get(lg_h5 *h5, lg_program **out, lg_error *error);

/* Fails for a model or program of format 1. */
lg_status lg_program_check_version(lg_h5 *h5, lg_error *error);

#endif
