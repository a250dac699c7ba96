/* files TABLE.csv: writes a table, reads it again, and tries to load a model that does not exist. */
#include <stdio.h>
#include <string.h>

#include <liegrad/program.h>
#include <liegrad/table.h>

int main(int argc, char **argv) {
    const char *const names[] = {"x", "y"};
    lg_table_data data;
    lg_program *program;
    lg_error error;
    FILE *to = argc == 2 ? fopen(argv[1], "w") : NULL;
    if (to == NULL || fputs("x,y\n1,2\n3,4\n", to) < 0 || fclose(to) != 0) return 1;
    if (lg_table_read(NULL, argv[1], names, 2, NULL, NULL, &data, &error) != LG_OK) return 2;
    if (data.rows != 2 || data.values[3] != 4.0) return 3;
    lg_table_data_destroy(&data);
    if (lg_program_load(NULL, "no/model.h5", NULL, &program, &error) != LG_NOT_FOUND) return 4;
    return strstr(error.message, "no/model.h5") != NULL ? 0 : 5;
}
