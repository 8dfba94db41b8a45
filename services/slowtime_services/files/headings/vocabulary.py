"""Words and units by which headings state rates, intervals, counts and durations.

Each list holds regular expressions of what stands before or behind a figure, in the languages
of the loggers that were met: English, German, French, Spanish, Italian, Portuguese, Dutch,
Polish, Swedish, Turkish, Russian, Chinese, Japanese.
"""

import re

FREQUENCY_UNITS = {
    "hz": 1.0, "hertz": 1.0, "khz": 1e3, "mhz": 1e6, "sps": 1.0, "s/s": 1.0, "sa/s": 1.0,
    "ks/s": 1e3, "ksps": 1e3, "ksa/s": 1e3, "msps": 1e6, "ms/s": 1e6, "1/s": 1.0, "s-1": 1.0,
    "s^-1": 1.0, "samples/s": 1.0, "samples/sec": 1.0, "samples/second": 1.0, "cps": 1.0,
    "samples per second": 1.0, "гц": 1.0, "кгц": 1e3, "赫兹": 1.0, "1/sec": 1.0,
    "pts/s": 1.0,
    "messwerte/s": 1.0, "werte/s": 1.0, "/s": 1.0, "/sec": 1.0, "per second": 1.0,
    "samp/sec": 1.0, "muestras/s": 1.0, "spl/s": 1.0, "1/min": 1 / 60, "points/s": 1.0,
    "points per second": 1.0, "points/sec": 1.0, "readings/s": 1.0, "scans/s": 1.0,
    "scans/sec": 1.0, "samples/min": 1 / 60, "s/sec": 1.0, "échantillons/s": 1.0,
}  # fmt: skip
TIME_UNITS = {
    "s": 1.0, "sec": 1.0, "secs": 1.0, "second": 1.0, "seconds": 1.0, "sek": 1.0,
    "sekunden": 1.0, "sekunde": 1.0, "secondes": 1.0, "seconde": 1.0, "segundos": 1.0,
    "secondi": 1.0, "seg": 1.0, "с": 1.0, "сек": 1.0, "秒": 1.0, "ms": 1e-3, "msec": 1e-3,
    "millisecond": 1e-3, "milliseconds": 1e-3, "millis": 1e-3, "millisekunden": 1e-3,
    "us": 1e-6, "µs": 1e-6, "μs": 1e-6, "usec": 1e-6, "microsecond": 1e-6, "мс": 1e-3,
    "microseconds": 1e-6, "micros": 1e-6, "ns": 1e-9, "nsec": 1e-9, "nanoseconds": 1e-9,
    "min": 60.0, "mins": 60.0, "minute": 60.0, "minutes": 60.0, "minuten": 60.0,
    "minutos": 60.0, "h": 3600.0, "hr": 3600.0, "hrs": 3600.0, "hour": 3600.0,
    "hours": 3600.0, "stunden": 3600.0, "std": 3600.0, "day": 86400.0, "days": 86400.0,
    "tag": 86400.0, "tage": 86400.0, "jour": 86400.0, "jours": 86400.0, "días": 86400.0,
    "dias": 86400.0, "giorni": 86400.0, "week": 604800.0, "weeks": 604800.0,
    "wochen": 604800.0,
}  # fmt: skip
_OF_SAMPLES = (
    r"(?:sampl\w*|scan|acquisition|acq|logging|log|data|digiti[sz]\w*|output data|adc|storage|"
    r"recording|measurement|readout|update|polling)"
)
RATE_KEYS = (
    rf"{_OF_SAMPLES}[\s-]*(?:rate|freq\w*\.?|speed)",
    r"(?:samples?|points?)\s*(?:per|/)\s*s(?:ec(?:ond)?)?(?:\s*(?:per|/)\s*ch(?:annel)?)?",
    r"(?:sampl(?:ed|ing)|recorded|acquired|digiti[sz]ed|logged|measured|abgetastet|"
    r"aufgezeichnet|gemessen)\s*(?:at|@|with|mit)(?![\w])",
    r"(?<![\w])rate\s+per\s+ch(?:annel)?(?![\w])",
    r"(?<![\w])f[\s_]?s(?:ample|ampling)?(?![\w])",
    r"(?<![\w])s\.?r\.?(?![\w])",
    r"(?<![\w])odr(?![\w])",
    r"(?<![\w])sps(?![\w])",
    r"(?:abtast|mess|sampling|aufzeichnungs|speicher|scan)[\s-]*(?:rate|frequenz)",
    r"fr[ée]quence\s+(?:d['’e]?\s*)?(?:[ée]chantillonnage|acquisition|mesure)",
    r"(?:taux|cadence|vitesse)\s+(?:d['’e]?\s*)?(?:[ée]chantillonnage|acquisition)",
    r"(?:frecuencia|tasa|velocidad)\s+de\s+(?:muestreo|adquisici[óo]n)",
    r"(?:frequenza|velocit[àa])\s+di\s+(?:campionamento|acquisizione)",
    r"(?:frequ[êe]ncia|taxa)\s+de\s+(?:amostragem|aquisi[çc][ãa]o)",
    r"(?:bemonsterings|sample)\s?frequentie",
    r"cz[ęe]stotliwo[śs][ćc]\s+pr[óo]bkowania",
    r"samplings?(?:frekvens|hastighet)",
    r"частота\s+(?:дискретизации|опроса)",
    r"采样(?:率|频率)",
    r"サンプリング(?:周波数|レート)",
    r"[öo]rnekleme\s+(?:frekans|h[ıi]z)\w*",
    r"(?<![\w])(?:rate(?:\s+hz)?|frequency)(?![\w])",
)
INTERVAL_KEYS = (
    rf"{_OF_SAMPLES}[\s-]*(?:interval|period|step|spacing)",
    r"sampl\w*[\s-]*time",
    r"time\s+between\s+(?:samples|points|readings|scans)",
    r"(?:sampl\w*|reading|scan)\s+every",
    r"(?<![\w])d[\s_]?[tx](?![\w])",
    r"(?<![\w])(?:delta|δ|Δ)[\s_-]*[tx](?![\w])",
    r"time[\s-]*(?:step|increment|interval|spacing|base|resolution)",
    r"(?<![\w])(?:x[\s-]*)?(?:incr?(?:ement)?|interval|spacing|step)(?![\w])",
    r"equally\s+spaced\s+at(?:\s+intervals\s+of)?",
    r"at\s+equally[\s-]*spaced\s+intervals\s+of",
    r"(?:abtast|mess|sampling|zeit)[\s-]*"
    r"(?:intervall|periode|abstand|schritt\w*|zeit|inkrement)",
    r"(?:pas|intervalle)\s+(?:de\s+temps|d['’e]?\s*[ée]chantillonnage)",
    r"p[ée]riode\s+d['’e]?\s*[ée]chantillonnage",
    r"(?:intervalo|per[íi]odo|paso)\s+de\s+(?:muestreo|tiempo|amostragem|tempo)",
    r"(?:intervallo|periodo|passo)\s+(?:di\s+campionamento|temporale)",
    r"(?<![\w])ts(?![\w])",
    r"шаг\s+(?:по\s+времени|дискретизации)",
    r"采样(?:间隔|周期)",
)
COUNT_KEYS = (
    r"(?<![\w])npts?(?![\w])",
    r"(?<![\w])n\s?data(?![\w])",
    r"(?<![\w])nsamp\w*(?![\w])",
    r"(?:number|num|no|nr|count|total)\s*\.?\s*(?:of\s+)?(?:data\s*)?"
    r"(?:points?|samples?|values?|data|readings?|rows?|scans?|pts)(?:\s+per\s+channel)?",
    r"(?:data|total)?\s*(?:points?|samples?)\s+"
    r"(?:count|number|total|recorded|per\s+channel|in\s+file)",
    r"(?:data|sample|record)\s+(?:count|length\s+in\s+samples)",
    r"(?<![\w])(?:samples|points|rows|scans|nsamples|npoints|nrows)(?![\w/])"
    r"(?!\s*(?:per|/))",
    r"anzahl\s+(?:der\s+)?(?:mess|abtast|daten)?[\s-]*(?:werte|punkte|samples|zeilen)",
    r"(?:mess)?wertanzahl",
    r"nombre\s+(?:de\s+|d['’]?\s*)(?:points|[ée]chantillons|mesures|valeurs)",
    r"n[úu]mero\s+de\s+(?:puntos|muestras|datos|pontos|amostras)",
    r"numero\s+(?:di\s+)?(?:punti|campioni)",
    r"число\s+(?:точек|отсч[её]тов)",
    r"采样点数|点数",
    r"aantal\s+(?:punten|samples|metingen)",
)
DURATION_KEYS = (
    r"duration(?:\s+time)?",
    r"(?:record|recording|signal|data|measurement|acquisition|sampling|test)[\s-]*"
    r"(?:length|duration|time)(?![\w])",
    r"length\s+of\s+record",
    r"total\s+(?:time|duration|length)",
    r"(?:mess|aufnahme|aufzeichnungs|gesamt)?[\s-]*dauer",
    r"mess?zeit",
    r"dur[ée]e(?:\s+(?:totale|de\s+(?:la\s+)?mesure|d['’]?\s*(?:acquisition|enregistrement)))?",
    r"duraci[óo]n",
    r"dura[çc][ãa]o",
    r"durata",
    r"tijdsduur|meetduur",
    r"длительность",
    r"时长|持续时间",
)
ABOUT_ELSE = re.compile(
    r"filter|cut[\s-]?off|corner|high[\s-]?pass|low[\s-]?pass|band|nyquist|resonan|natural|"
    r"trigger|pre[\s-]?event|post[\s-]?event|baud|sweep|excit|block|buffer|window|fft|"
    r"channels?\s+count|grenzfreq|filtre|filtro|gps|temperatur|delay|timeout|heartbeat|"
    r"display|spectr|damping|max\w*\s*(?:acc|vel|disp)|peak|version|response|overlap|average|"
    r"grid|fundamental|heart\s+rate|sensor\s+range|bit\s*rate|frame\s+size",
    re.I,
)
"""Words of lines whose figures are not of the sampling of the record."""
FINAL = re.compile(
    r"(?:decimat|down[\s-]?sampl|re[\s-]?sampl|reduced|stored|saved|written|export|converted|"
    r"averaged|sub[\s-]?sampl|thinned|dezimiert|reduziert|heruntergetaktet|gespeichert|"
    r"sous[\s-]?[ée]chantill|r[ée][\s-]?[ée]chantill|d[ée]cim|remuestre|submuestre|diezm|"
    r"ricampion|sottocampion|decimad|reamostr)\w*\s*(?:\w+\s+){0,3}?"
    r"(?:to|at|with|auf|mit|à|a|en|con|por|in|@|:|=)\s*",
    re.I,
)
"""Words before the rate at which samples were written, whatever the converter's."""
BEFORE = re.compile(
    r"converter|\badc\b|\ba/d\b|original|raw|internal|intern|before|hardware|oversampl|"
    r"wandler|convertisseur|conversor|native|input|modulator|from\s*$",
    re.I,
)
"""Words of a rate that holds before samples were thinned."""
FACTOR = re.compile(
    r"(?:decimation|down[\s-]?sampling|averaging|dezimation|d[ée]cimation)"
    r"(?:\s*(?:factor|ratio|faktor|by))?\s*[:=]?\s*(?:of\s+|by\s+)?"
    r"(?P<f>\d{1,6})(?![\d.]|\s*k?hz)|"
    r"decimated\s+by\s+(?:a\s+factor\s+of\s+)?(?P<g>\d{1,6})|"
    r"every\s+(?P<h>\d{1,6})(?:st|nd|rd|th)\s+sample",
    re.I,
)
"""By how much samples were thinned."""
