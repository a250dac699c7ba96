# Points of two columns and a straight line.
# T[1]: 2 columns, T[2]: classes; then the names of the columns, those of the classes; then the ends of both axes, and 1 with a
# line, else 0. index 1 to T[2]: points of a class; the last: two points of the line.
m = int(V(2))
class(c) = T[4 + c]
set xlabel T[3] noenhanced font small(T[3])
set ylabel T[4] noenhanced font small(T[4])
set xrange [V(5 + m):V(6 + m)]
set yrange [V(7 + m):V(8 + m)]
set clip two
plot for [c = 1:m] datafile index c using 1:2 with points pt 7 ps 0.4 lc rgb colour(c) notitle, \
    for [c = 1:m] keyentry with points pt 7 ps 0.8 lc rgb colour(c) title class(c) noenhanced, \
    for [k = 1:V(9 + m)] datafile index m + 1 using 1:2 with lines lw 1.5 lc rgb '#333333' title 'decision'
