# A confusion matrix, coloured by the fraction of each row. T[1]: classes, T[2]: title; then the names of the classes.
# Columns: given class (0, 1, ...), true class, count. Above 24 classes the numbers would not fit.
m = int(V(1))
# The margins have 9 pixels for each letter of a name, or 7 in the smaller font of long names.
longest = 0
do for [c = 1:m] { if (strlen(T[2 + c]) > longest) { longest = strlen(T[2 + c]) } }
is_long = longest > 16
letters = is_long ? ",7" : ""
left = (is_long ? 7 : 9)*longest + 60.0
below = is_long ? left : 60.0
cells = 220 + 110*(m < 12 ? m : 12)
width = cells + left - 80
height = cells + below - 60
eval size(width, height)
array total[m]
do for [c = 1:m] {
    stats datafile index 1 using ($2 == c - 1 ? $3 : 0) nooutput
    total[c] = STATS_sum
}
part(row, x) = total[row + 1] > 0 ? x/total[row + 1] : 0
set lmargin at screen left/width
set rmargin at screen 1 - 40.0/width
set bmargin at screen below/height
set tmargin at screen 1 - 50.0/height
set title T[2] noenhanced
unset key
unset colorbox
unset grid
set label 'given' at graph 0.5, screen 20.0/height center
set label 'true' at screen 20.0/width, graph 0.5 center rotate
set xrange [-0.5:m - 0.5]
set yrange [m - 0.5:-0.5]
set cbrange [0:1]
set palette defined (0 '#f4f7fb', 1 '#1f5fa8')
set xtics font letters
if (is_long) { set xtics rotate }
set ytics font letters
set xtics noenhanced ()
set ytics noenhanced ()
set for [c = 1:m] xtics add (tic(T[2 + c]) c - 1)
set for [c = 1:m] ytics add (tic(T[2 + c]) c - 1)
plot datafile index 1 using 1:2:(part($2, $3)) with image pixels, \
    for [k = 1:m <= 24] datafile index 1 using 1:2:(sprintf("%d\n%.1f %%", $3, 100*part($2, $3))):(part($2, $3) > 0.55 ? 0xffffff : 0x222222) \
        with labels tc rgb variable
