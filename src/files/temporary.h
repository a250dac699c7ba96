/* Names of locks and temporary files, and how these files are made and removed. Functions that fail return
 * false or -1 and set errno. */
#ifndef LG_TEMPORARY_H
#define LG_TEMPORARY_H

#include "liegrad/files.h"

enum { LG_OWN_NAME = 160 }; /* bytes for a name with its terminator */

/* Writes the name .BASE.liegrad-ENDING, where BASE is the last part of the path `target`. A long
 * BASE is replaced by its SHA-256, because file systems limit the length of names. */
void lg_own_name(const char *target, const char *ending, char out[LG_OWN_NAME]);
/* Fails with LG_FILE if `target` has a name of this form. */
lg_status lg_refuse_own_name(const char *target, lg_error *error);
/* The length of the part of the path before its last component, with the slash. */
size_t lg_folder_length(const char *target);
/* Returns whether the path is a symbolic link to a file that does not exist. Writers do not replace it. */
bool lg_is_lost_link(const char *path);
#define LG_LOST_LINK "it is a symbolic link to a file that does not exist"
/* Opens the folder that contains `target`, for calls that work relative to a folder. */
int lg_open_folder(const char *target);
/* Returns whether `name` in the folder leads to the opened file. A symbolic link does not. */
bool lg_has_name(int fd, int folder, const char *name);
/* Renames a file, but not if the new name exists (EEXIST). */
bool lg_give_name(int folder, const char *from, const char *to);
/* Removes what killed writers of the target left in its folder. */
void lg_sweep(int folder, const char *target);
/* Creates and locks a temporary file or folder of the target. Returns its descriptor and its name. */
int lg_make_temporary(int folder, const char *target, bool is_folder, char name[LG_OWN_NAME]);
/* For executables, at their end: removes the files and empty folders of lg_temporary_create that are open
 * and still have their temporary names, as after an end for lack of memory. */
void lg_temporary_remove_all(void);
/* Writes all bytes, also if the limit RLIMIT_FSIZE is reached. Returns 0 or a number of errno. */
int lg_write_all(int fd, const void *data, size_t bytes);
/* Fails with lg_status_of(code) and the message of a number of errno. */
lg_status lg_cannot_write(const char *target, int code, lg_error *error);
/* fsync; the kinds of files that cannot be synced are no failure. Returns 0 or a number of errno. */
int lg_sync(int fd);

#endif
