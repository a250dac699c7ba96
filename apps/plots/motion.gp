# A moving chain or moving quadrotors in space. T[1]: chain or quadrotors, T[2]: links, T[3]: number of snapshots, then the title of each; then the ends
# of the ranges of x, y and z. index 1: the path, x y z. Then a block for each snapshot: x y z of the masses, or the beginning x y z and the vector of each line.
count = V(3)
low(i) = V(2 + count + 2*i)
high(i) = V(3 + count + 2*i)
longest = high(1) - low(1)
do for [i = 2:3] { longest = high(i) - low(i) > longest ? high(i) - low(i) : longest }
# About five tics on the longest axis.
power = 10**floor(log10(longest / 5))
distance = longest / 5 > 5*power ? 10*power : longest / 5 > 2*power ? 5*power : longest / 5 > power ? 2*power : power
# From light to dark with time.
part(light, dark, k) = int(light + (count > 1 ? (k - 1) / (count - 1) : 1) * (dark - light) + 0.5)
shade(k) = 65536*part(190, 16, k) + 256*part(210, 54, k) + part(235, 104, k)
set tics nomirror
set view equal xyz
set xyplane relative 0
set xrange [low(1):high(1)]
set yrange [low(2):high(2)]
set zrange [low(3):high(3)]
set xtics distance
set ytics distance
set ztics distance
set border 31 lc rgb '#bbbbbb'
set tics textcolor rgb '#555555'
set key at screen 0.98,0.93 right top vertical samplen 2 nobox
if (T[1] eq 'chain') {
    set title V(2) > 1 ? 'the chain, and the path of its last mass' : 'the pendulum and its path'
    set view 68,30,1.15
    set xlabel 'x [m]'
    set ylabel 'y [m]'
    set zlabel 'z [m]' rotate
    splot datafile index 1 using 1:2:3 with lines lw 0.8 lc rgb '#d1641f' title 'path', \
        for [k = 1:count] datafile index k+1 using 1:2:3 with linespoints lw 2 pt 7 ps (V(2) > 10 ? 0.4 : 0.8) lc rgb shade(k) title T[3 + k]
} else {
    set title 'payload, links and quadrotors; up is -e_{3}'
    set view 75,20,1.15
    set xlabel 'e_{1}  [m]'
    set ylabel '-e_{2}  [m]'
    set zlabel '-e_{3}  [m]' rotate
    splot datafile index 1 using 1:2:3 with lines lw 1.2 lc rgb '#d1641f' title 'payload', \
        for [k = 1:count] datafile index k+1 using 1:2:3:4:5:6 with vectors nohead lw 2 lc rgb shade(k) title T[3 + k]
}
