/* Dates and times as text. */
#ifndef CONURB_BASE_DATE_H
#define CONURB_BASE_DATE_H
/* xsd:dateTime, as in KML, GPX and MP4: 2010-05-28T02:02:09.5Z, or with +hh:mm. Seconds since 1970 (UTC); NaN when the
 * text is something else. Any thread. */
double cn_parse_date_time(const char *text);
#endif
