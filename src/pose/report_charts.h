/* The charts of poses/report.html. */
#ifndef CONURB_POSE_REPORT_CHARTS_H
#define CONURB_POSE_REPORT_CHARTS_H
#include "pose/quality.h"
#include <stdio.h>

/* Number of photos that the map and the charts by photo show: all, or every second, third and so on of very many. */
uint32_t cn_report_drawn(const cn_quality *q);
/* Each writes one SVG element into the page. CN_ERR_NOMEM. */
CN_NODISCARD cn_status cn_report_draw_map(const cn_quality *q, FILE *out);
CN_NODISCARD cn_status cn_report_draw_gps(const cn_quality *q, FILE *out);
CN_NODISCARD cn_status cn_report_draw_histogram(const cn_quality *q, FILE *out);
CN_NODISCARD cn_status cn_report_draw_errors(const cn_quality *q, FILE *out);
#endif
