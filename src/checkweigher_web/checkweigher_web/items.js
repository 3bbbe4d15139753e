// Copyright 2026 Checkweigher maintainers
// SPDX-License-Identifier: Apache-2.0
// The list of items. Its rows come as one text, which the server makes once for all viewers:
// a key, the number of the item, the decision, and the texts of the other columns.
export default {
  template: `
    <table class="plain">
      <thead><tr><th v-for="head in heads" scope="col">{{ head }}</th></tr></thead>
      <tbody>
        <tr v-for="[key, number, decision, ...texts] in list" :key="key"
            :class="[decision, { chosen: key === chosen }]">
          <td>
            <button :aria-label="'show item ' + number" :aria-pressed="key === chosen"
                    @click="$emit('choose', key)">{{ number }}</button>
          </td>
          <td v-for="text in texts">{{ text }}</td>
        </tr>
      </tbody>
    </table>`,
  props: { heads: Array, rows: { type: String, default: "[]" }, chosen: String },
  emits: ["choose"],
  computed: {
    list() {
      return JSON.parse(this.rows);
    },
  },
};
