# Each channel of recordings against time; with six or more channels also channels 5 and 6 against channels 1 and 2.
# T[1]: recordings, T[2]: channels; then the names of the recordings, those of the channels.
# index 1, 2, ...: a recording (minutes, then the channels). The first recording is drawn last, on top.
count = int(V(1))
channels = int(V(2))
recording(r) = T[2 + r]
name(k) = T[2 + count + k]
pairs = channels < 6 ? 0 : 2
rows = int(channels + 1)/2 + pairs/2
eval size(1240, 210*rows + 60)
set multiplot layout rows,2
set key samplen 1
do for [k = 1:channels] {
    set xlabel 'minutes'
    set ylabel name(k) noenhanced font small(name(k))
    plot for [r = count:1:-1] datafile index r using 1:(column(1 + k)) \
        with lines lw 0.4 lc rgb colour(r) title recording(r) noenhanced
}
do for [k = 1:pairs] {
    set xlabel name(k) noenhanced font small(name(k))
    set ylabel name(k + 4) noenhanced font small(name(k + 4))
    plot for [r = count:1:-1] datafile index r using 1 + k:5 + k with dots lc rgb colour(r) title recording(r) noenhanced
}
