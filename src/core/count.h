/* Number of elements of an array. `array` must not be a pointer. */
#ifndef LG_CORE_COUNT_H
#define LG_CORE_COUNT_H

#define LG_COUNT(array) (sizeof(array) / sizeof((array)[0]))

#endif
