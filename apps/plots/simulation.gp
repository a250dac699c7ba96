# Panels of a run. Each panel has its kind and: components: key of a part of the state, 1 for systems with links, number of parts with this key, how
# many are drawn, number of components of each; then the indices of those that are drawn, and the names of the components; phase: labels of x and y;
# invariants: number of invariants, their names; manifold, steps: nothing. All texts are of our own tables.
# index 1: t, step, distance from the manifold, drift of each invariant. Then for each panel of components a block of t and its curves,
# for a phase portrait a block of x and y.
length(at) = T[at] eq 'components' ? 6 + V(at + 4) + V(at + 5) : T[at] eq 'phase' ? 3 : T[at] eq 'invariants' ? 2 + V(at + 1) : 1
panels = 0
at = 1
while (at <= count) {
    panels = panels + 1
    at = int(at + length(at))
}
rows = (panels + 1) / 2
eval size(panels > 1 ? 1120 : 900, rows > 1 ? 380*rows : 520)
# Symbols and units of a part of the state; the units are those of chains, where q is a direction. Names such as q_{2,x}.
symbol(key) = (out = key, sum [i = 1:6] (out = word('omega Omega mu pi Pi Gamma', i) eq key ? word('ω Ω μ π Π Γ', i) : out, 0), out)
unit(key, links) = key eq 'omega' || key eq 'Omega' ? ' [rad/s]' : key eq 'mu' || key eq 'pi' || key eq 'Pi' || (key eq 'p' && links > 0) ? ' [kg m^2/s]' : \
    key eq 'y' ? ' [m]' : key eq 'v' ? ' [m/s]' : ''
below(index, part) = (out = (index eq '0' ? '' : index).(index eq '0' || part eq '' ? '' : ',').part, out eq '' ? '' : '_{'.out.'}')
# A logarithmic axis shows no zero: y(column) is NaN there, and a panel without a curve shows the reason.
y(k) = column(k) > 0 ? column(k) : NaN
reason = ''
stats datafile index 1 using (1) nooutput
style = STATS_records >= 400 ? "lines" : "linespoints pt 7 ps 0.3"
set multiplot layout rows, panels > 1 ? 2 : 1
at = block = 1
do for [k = 1:panels] {
    kind = T[at]
    first = kind eq 'invariants' ? 4 : kind eq 'manifold' ? 3 : 2
    last = kind eq 'invariants' ? 3 + int(V(at + 1)) : first
    set autoscale
    set xtics nomirror
    set ytics nomirror
    set xlabel 't [s]'
    if (kind eq 'components' || kind eq 'phase') {
        block = block + 1
        unset logscale y
        set format y '%g'
        set key outside right top samplen 1.5 nobox
    } else {
        shown = 0
        most = 0.0
        array shows[last > 0 ? last : 1]
        do for [c = first:last] {
            stats datafile index 1 using (finite(c, 0)) nooutput
            shows[c] = STATS_max > 0
            shown = shown + shows[c]
            most = STATS_max
        }
        eval powers('y')
        set key inside bottom right samplen 1.5 nobox
    }
    if (kind eq 'components') {
        key = T[at + 1]
        parts = int(V(at + 4))
        each = int(V(at + 5))
        list = ''
        do for [k = 1:parts] { list = list.(k > 1 ? ', ' : '').symbol(key).'_{'.T[at + 5 + k].'}' }
        set title 'components of '.(V(at + 3) == parts ? symbol(key) : sprintf('%s (of %d)', list, V(at + 3)))
        set ylabel symbol(key).unit(key, V(at + 2))
        plot for [c = 1:parts*each] datafile index block using 1:c+1 with lines lw 1.6 lc rgb colour(c) \
            title symbol(key).below(T[at + 6 + (c - 1)/each], T[at + 6 + parts + (c - 1)%each])
    }
    if (kind eq 'phase') {
        set title 'phase portrait'
        set xlabel T[at + 1]
        set ylabel T[at + 2]
        unset key
        set size ratio -1
        set offsets graph 0.04, graph 0.04, graph 0.04, graph 0.04
        plot datafile index block using 1:2 with lines lw 1.2 lc rgb colour(1)
        set size noratio
        unset offsets
    }
    if (kind eq 'invariants') {
        set title 'drift of the invariants'
        set ylabel '|I(t) - I(0)|'
        reason = last > 3 ? 'zero all along' : 'the system has none'
    }
    if (kind eq 'manifold') {
        set title 'distance from the manifold'
        set ylabel 'largest violation of a constraint'
        reason = 'zero all along'
    }
    if (kind eq 'steps') {
        set title 'accepted steps'
        set ylabel 'h [s]'
        reason = 'no steps'
    }
    if (kind ne 'components' && kind ne 'phase' && shown == 0) {
        unset xtics
        unset ytics
        unset logscale y
        set format y '%g'
        plot [0:1] [-1:1] NaN title reason
    }
    if (kind eq 'invariants' && shown > 0) {
        plot for [c = first:last] datafile index 1 using 1:(y(c)) with lines lw 1.4 lc rgb colour(sum [e = first:c] shows[e]) title (shows[c] ? T[at - 2 + c] : '')
    }
    if (kind eq 'manifold' && shown > 0) {
        set yrange [1e-17:*]
        if (most < 1e-14) { set yrange [1e-17:1e-13] }
        plot datafile index 1 using 1:(y(3)) with points pt 7 ps 0.25 lc rgb colour(4) notitle
    }
    if (kind eq 'steps' && shown > 0) {
        plot datafile index 1 using 1:(y(2)) with @style lw 1.4 lc rgb colour(3) notitle
    }
    at = int(at + length(at))
}
