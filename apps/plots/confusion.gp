# A confusion matrix, coloured by the fraction of each row. T[1]: classes, T[2]: title; then the names of the classes.
# Columns: given class (0, 1, ...), true class, fraction of the row, count. Above 24 classes the numbers would not fit.
m = int(V(1))
set title T[2] noenhanced
unset key
unset colorbox
unset grid
set size square
set xlabel 'given'
set ylabel 'true'
set xrange [-0.5:m - 0.5]
set yrange [m - 0.5:-0.5]
set cbrange [0:1]
set palette defined (0 '#f4f7fb', 1 '#1f5fa8')
set xtics noenhanced ()
set ytics noenhanced ()
set for [c = 1:m] xtics add (tic(T[2 + c]) c - 1)
set for [c = 1:m] ytics add (tic(T[2 + c]) c - 1)
plot datafile index 1 using 1:2:3 with image pixels, \
    for [k = 1:m <= 24] datafile index 1 using 1:2:(sprintf("%d\n%.1f %%", $4, 100*$3)):($3 > 0.55 ? 0xffffff : 0x222222) \
        with labels tc rgb variable
