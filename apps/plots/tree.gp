# A decision tree, down to a level. T[1]: leaves that are drawn, T[2]: levels that are drawn, T[3]: levels, T[4]: nodes of the
# whole tree, T[5]: boxes; then for each box the name of its column or class, what follows it, x, level (`with labels` would read
# quotes and backslashes in a name).
# index 1: lines between the boxes. index 2, a line for each box: x, level, class (1, 2, ...), fraction of its samples in this class.
channel(rgb, k) = ('0x'.rgb[2*k:2*k + 1]) + 0
pale(rgb, part) = sum [k = 1:3] int(255.5 - part*(255 - channel(rgb, k)))*256**(3 - k)
short(text) = text[1:40]
box(k, i) = T[4*k + 1 + i]
unset key
unset border
unset tics
unset grid
if (V(3) > V(2)) { set title sprintf('the first %d of %d levels, %d nodes', V(2), V(3), V(4)) }
set xrange [-0.7:V(1) - 0.3]
set yrange [V(2) + 0.5:-0.5]
set for [k = 1:V(5)] label short(box(k, 1)).box(k, 2) at real(box(k, 3)),real(box(k, 4)) center noenhanced font ',8' front offset 0,0.4
plot datafile index 1 with lines lc rgb '#666666', \
    datafile index 2 using 1:2:(0.47):(0.25):(pale(colour($3), 0.1 + 0.6*$4)) \
        with boxxyerror fs solid 1 border lc rgb '#444444' lc rgb variable
