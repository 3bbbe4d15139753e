// Copyright 2026 Checkweigher maintainers
// SPDX-License-Identifier: Apache-2.0
// Figure that ECharts draws. Its options are one text, which the server makes once for all viewers.
// A colour in the options is the name of a CSS variable, so that each browser uses its own theme.
import { echarts } from "nicegui-echart";

// Colours of the CSS variables, by the classes of the body, which select the theme. Each colour is
// looked up only once, because a lookup makes the browser compute the styles of the page.
const known = {};

// Dates as a language writes them: the pattern of a day and the names of the months for ECharts,
// and a function that writes a time. Positions on a time axis are local times as UTC.
function dates(lang) {
  const format = options => new Intl.DateTimeFormat(lang, { timeZone: "UTC", ...options });
  const month = format({ month: "short" }), whole = format({ month: "short", day: "numeric" });
  const patterns = { day: () => "{d}", month: value => isNaN(value) ? "{MMM}" : "{M}" };
  return {
    day: whole.formatToParts(0).map(({ type, value }) => patterns[type]?.(value) ?? value).join(""),
    monthAbbr: [...Array(12).keys()].map(number => month.format(Date.UTC(2000, number))),
    moment: format({ dateStyle: "medium", timeStyle: "medium", hourCycle: "h23" }).format,
  };
}

export default {
  template: "<div></div>",
  props: { text: String, linked: Boolean },
  emits: ["span", "at"],
  watch: {
    text() {
      if (this.inSight) this.draw();
    },
  },
  mounted() {
    this.resized = new ResizeObserver(() => {
      this.chart?.resize();
      if (this.shown !== this.text) this.draw();
    });
    this.resized.observe(this.$el);
    // A figure outside the window is drawn again when the user scrolls to it.
    this.scrolled = new IntersectionObserver(entries => {
      this.inSight = entries.at(-1).isIntersecting;
      if (this.inSight && this.shown !== this.text) this.draw();
    });
    this.scrolled.observe(this.$el);
    this.themed = new MutationObserver(() => {
      if (this.chart && this.theme !== this.colour("--card")) this.draw();
    });
    this.themed.observe(document.body, { attributeFilter: ["class"] });
  },
  beforeUnmount() {
    this.resized.disconnect();
    this.scrolled.disconnect();
    this.themed.disconnect();
    this.chart?.dispose();
  },
  methods: {
    draw() {
      if (!this.$el.clientWidth) return; // ECharts cannot start in an element without a size.
      this.shown = this.text;
      const colour = name => this.colour(name);
      if (this.theme !== colour("--card")) {
        this.theme = colour("--card");
        this.chart?.dispose();
        this.chart = this.begin(colour);
        if (this.linked) this.link();
      }
      const options = JSON.parse(this.text, (_, value) =>
        typeof value === "string" && value.startsWith("--") ? colour(value) : value);
      if (options.height) this.$el.style.height = `${options.height}px`;
      for (const each of options.dataZoom ?? []) Object.assign(each, this.zoom);
      this.chart.setOption(options, { notMerge: true });
    },
    // Show the whole time axis again.
    whole() {
      this.zoom = undefined;
      this.draw();
    },
    link() {
      this.chart.on("datazoom", () => {
        clearTimeout(this.settled); // Wait until the user has stopped dragging.
        this.settled = setTimeout(() => {
          const { start, end, startValue, endValue } = this.chart.getOption().dataZoom[0];
          this.zoom = start > 0 || end < 100 ? { startValue, endValue } : undefined;
          this.$emit("span", this.zoom ? [startValue, endValue] : null);
        }, 200);
      });
      this.chart.getZr().on("click", ({ offsetX, offsetY }) => {
        const options = this.chart.getOption();
        const row = options.grid?.findIndex((_, gridIndex) =>
          this.chart.containPixel({ gridIndex }, [offsetX, offsetY])) ?? -1;
        if (row >= 0) {
          this.$emit("at", this.chart.convertFromPixel({ xAxisIndex: row }, offsetX));
        }
      });
    },
    begin(colour) {
      const text = { color: colour("--muted") }, ink = { color: colour("--ink") };
      const axis = { axisLabel: text, nameTextStyle: text, axisLine: { lineStyle: text },
                     axisTick: { lineStyle: text },
                     splitLine: { lineStyle: { color: colour("--line") } } };
      // Format numbers in the language of the page.
      const numbers = new Intl.NumberFormat(
        document.documentElement.lang, { maximumFractionDigits: 6 });
      const shown = value => typeof value === "number" ? numbers.format(value) : value;
      const valueAxis = { ...axis, axisLabel: { ...text, formatter: shown } };
      const { day, monthAbbr, moment } = dates(document.documentElement.lang);
      const timeAxis = { ...axis, axisLabel: { ...text, formatter: { day } },
                         axisPointer: { label: { formatter: ({ value }) => moment(value) } } };
      return echarts.init(this.$el, {
        valueAxis, categoryAxis: axis, timeAxis, legend: { textStyle: ink },
        tooltip: { valueFormatter: shown, backgroundColor: this.theme, borderColor: colour("--line"), textStyle: ink },
      }, { locale: { time: { monthAbbr } } });
    },
    // Colour of a CSS variable in the present theme.
    colour(name) {
      const colours = (known[document.body.className] ??= {});
      if (colours[name]) return colours[name];
      const probe = this.$el.appendChild(document.createElement("i"));
      probe.style.color = `var(${name})`;
      const found = getComputedStyle(probe).color;
      probe.remove();
      return (colours[name] = found);
    },
  },
};
