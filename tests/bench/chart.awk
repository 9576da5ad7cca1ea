# An SVG bar chart of how much of its limit each kernel reaches, from the CSV of bench_field: one bar a kernel and
# instruction set, full width
# at 100 %. usage: awk -f chart.awk kernels.csv > kernels.svg
BEGIN { FS = ","; row = 18; left = 270; full = 420; top = 46; split("#9aa5b1 #2f6f9f #c2571a #5b8c3a", colour, " ") }
FNR == 1 { next }
{
    if (!($2 in set)) { set[$2] = ++sets; name[sets] = $2 }
    n++
    label[n] = $1; of[n] = $2; ns[n] = $3; limit[n] = $6; share[n] = $8
}
END {
    height = top + n * row + 30
    printf "<svg xmlns=\"http://www.w3.org/2000/svg\" width=\"900\" height=\"%d\" ", height
    print "font-family=\"sans-serif\" font-size=\"12\">"
    print "<rect width=\"100%\" height=\"100%\" fill=\"white\"/>"
    print "<text x=\"10\" y=\"18\" font-size=\"14\">" \
        "Share of the limit that binds each kernel, measured in the same run (100 % is the limit)</text>"
    for (i = 1; i <= sets; i++)
        printf "<rect x=\"%d\" y=\"26\" width=\"10\" height=\"10\" fill=\"%s\"/>" \
            "<text x=\"%d\" y=\"35\">%s</text>\n", left + (i - 1) * 110, colour[i],
            left + (i - 1) * 110 + 14, name[i]
    for (i = 1; i <= n; i++) {
        y = top + (i - 1) * row
        wide = share[i] < 1.4 ? share[i] : 1.4
        printf "<text x=\"%d\" y=\"%d\" text-anchor=\"end\">%s, %s</text>\n", left - 6, y + 13, label[i], of[i]
        printf "<rect x=\"%d\" y=\"%d\" width=\"%.1f\" height=\"%d\" fill=\"%s\"/>\n", left, y + 2, wide * full,
            row - 4, colour[set[of[i]]]
        printf "<text x=\"%.1f\" y=\"%d\">%.0f %% of %s, %.2f ns</text>\n", left + wide * full + 5, y + 13,
            100 * share[i], limit[i], ns[i]
    }
    printf "<line x1=\"%d\" y1=\"%d\" x2=\"%d\" y2=\"%d\" stroke=\"black\" stroke-dasharray=\"3 3\"/>\n", left + full,
        top, left + full, top + n * row
    print "</svg>"
}
