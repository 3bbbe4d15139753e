// Copyright 2026 Checkweigher maintainers
// SPDX-License-Identifier: Apache-2.0
// Age, clock, theme and full-screen mode of the page. The server sends a heartbeat each second. If
// the heartbeats stop, the browser greys the page.
const LATE = 3000; // age in ms from which the page is grey: three periods of the heartbeat
const APART = 5000; // difference in ms between the clocks of browser and line that is shown
const IDLE = 600000; // time in ms without items, alarms or touches until a full screen is dimmed
const THEME = "checkweigher-theme";

export default {
  template: `
    <div><div class="late" role="alert">{{ text }}</div>
    <div class="apart" role="status">{{ apart }}</div></div>`,
  // `age` of the state in s, its time `since` as text, time of the line `now` in ms, and the text
  // `wakes`, whose changes wake a dimmed screen.
  props: { beat: Number, age: { type: Number, default: 0 }, since: String, now: Number,
           wakes: String, texts: Object },
  data: () => ({ came: performance.now(), touched: performance.now(), text: "", apart: "" }),
  watch: {
    beat() {
      this.came = performance.now() - 1000 * this.age;
      const late = Math.round((Date.now() - this.now) / 1000);
      this.apart = Math.abs(late) * 1000 < APART ? "" :
        this.texts[late > 0 ? "ahead" : "behind"].replace("{seconds}", Math.abs(late));
      this.look();
    },
    wakes() {
      this.wake();
    },
  },
  mounted() {
    setDark({ dark: true, light: false }[localStorage.getItem(THEME)] ?? null);
    document.body.classList.toggle("kiosk", new URLSearchParams(location.search).has("kiosk"));
    this.timer = setInterval(this.look, LATE / 6);
    for (const event of ["pointerdown", "keydown"]) document.addEventListener(event, this.wake);
    document.addEventListener("fullscreenchange", this.resize);
  },
  beforeUnmount() {
    clearInterval(this.timer);
    for (const event of ["pointerdown", "keydown"]) document.removeEventListener(event, this.wake);
    document.removeEventListener("fullscreenchange", this.resize);
  },
  methods: {
    look() {
      const age = performance.now() - this.came;
      this.text = age > LATE ? this.texts.late.replace("{since}", this.since)
        .replace("{ago}", Math.round(age / 1000)) : "";
      document.body.classList.toggle("stale", age > LATE);
      const idle = performance.now() - this.touched > IDLE && age < LATE;
      document.body.classList.toggle("dimmed", idle && document.body.classList.contains("kiosk"));
    },
    wake() {
      this.touched = performance.now();
      this.look();
    },
    theme() {
      const dark = !document.body.classList.contains("body--dark");
      localStorage.setItem(THEME, dark ? "dark" : "light");
      setDark(dark);
    },
    full() {
      if (document.fullscreenElement) document.exitFullscreen();
      else document.documentElement.requestFullscreen();
    },
    resize() {
      document.body.classList.toggle("kiosk", !!document.fullscreenElement);
    },
  },
};
